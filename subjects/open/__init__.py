"""Open clothed humans made from seeds; see `OpenHumans`."""

from subjects.open.source import OpenHumans

__all__ = ["OpenHumans"]
