"""What a person sees of a build: a bar on a terminal, lines elsewhere."""

import io

from engine.progress import Progress


class Terminal(io.StringIO):
    """A stream that calls itself a terminal."""

    def isatty(self) -> bool:
        """Always."""
        return True


def run(stream: io.StringIO) -> str:
    progress = Progress("render", 3, views_per_subject=14, stream=stream)
    progress.step("anna")
    progress.step("bert", "bert.obj: the mesh has no faces")
    progress.step("cleo")
    progress.close()
    return stream.getvalue()


def test_lines_tell_subjects_rate_and_time_left():
    lines = run(io.StringIO()).splitlines()
    assert len(lines) == 3
    assert "render 1/3, anna" in lines[0]
    assert "views/s" in lines[0]
    assert "s left" in lines[0]
    assert lines[1].strip() == "set aside bert: bert.obj: the mesh has no faces"
    assert "render 3/3, cleo" in lines[2]
    assert "0 s left" in lines[2]


def test_a_terminal_gets_one_bar_and_every_failure_a_line():
    text = run(Terminal())
    assert "3/3 subjects" in text
    assert "left" in text
    assert "views/s" in text
    assert "set aside bert: bert.obj: the mesh has no faces\n" in text
    assert "render 1/3, anna" not in text
