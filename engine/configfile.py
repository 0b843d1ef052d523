"""A configuration's file, looked at before a parser makes anything of it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml
from jsonargparse import ActionConfigFile

LARGEST = 2**18
"""Bytes of a file; the longest in `configs` has a few thousand."""

MOST_VALUES = 10_000
"""Values of a file, each counted as often as aliases repeat it."""

DEEPEST = 30
"""Levels that values may nest."""


class ConfigFile(ActionConfigFile):
    """The option --config, of a file that `check_config` passes.

    A parser copies and prints what aliases repeat, which a few lines make billions of values.
    """

    def __call__(self, parser: Any, namespace: Any, value: Any, option: Any = None) -> None:
        """Take the file's values.

        Raises:
            TypeError: they cannot be read; the parser makes a wrong call of it.
        """
        try:
            if Path(value).is_file():
                check_config(Path(value))
            super().__call__(parser, namespace, value, option)
        except (ValueError, OverflowError, yaml.YAMLError) as error:
            raise TypeError(f'Parser key "{self.dest}": {error}') from error


def check_config(path: Path) -> None:
    """Refuse a file that no configuration needs.

    Raises:
        ValueError: it is no text, or larger, deeper or more often repeated than it may be.
        yaml.YAMLError: it is no YAML.
        OSError: it cannot be opened.
    """
    with path.open("rb") as file:
        data = file.read(LARGEST + 1)
    if len(data) > LARGEST:
        raise ValueError(f"has over {LARGEST} bytes; give a configuration, see configs/")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"is no UTF-8 text ({error.reason}); save it as UTF-8") from None
    _check_values(yaml.parse(text, Loader=yaml.SafeLoader))


def _check_values(events: Iterable[yaml.Event]) -> None:
    """ValueError where there are too many values, or too deep."""
    counts = [0]  # of the values so far in each collection that is open
    anchors: list[str | None] = [None]
    sizes: dict[str, int] = {}  # of what has an anchor
    for event in events:
        if isinstance(event, yaml.CollectionStartEvent):
            counts.append(1)
            anchors.append(event.anchor)
            size, anchor = 0, None
        elif isinstance(event, yaml.CollectionEndEvent):
            size, anchor = counts.pop(), anchors.pop()
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError(f"has an alias *{event.anchor} within itself; write its value out")
            size, anchor = sizes[event.anchor], None
        elif isinstance(event, yaml.ScalarEvent):
            size, anchor = 1, event.anchor
        else:
            continue
        counts[-1] += size
        if anchor is not None:
            sizes[anchor] = size
        if counts[-1] > MOST_VALUES or len(counts) > DEEPEST:
            raise ValueError(
                f"has over {MOST_VALUES} values or {DEEPEST} levels, repeated ones counted; "
                "give a configuration, see configs/"
            )
