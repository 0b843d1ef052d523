"""What an open human looks like: the draw of its colours, and the one texture they make."""

from subjects.open.texture.look import Look, draw_look
from subjects.open.texture.picture import paint

__all__ = ["Look", "draw_look", "paint"]
