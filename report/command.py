"""What the reports' command lines share."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path


def parser(description: str) -> argparse.ArgumentParser:
    """A command line that begins with the dataset; of `description` the first line is shown."""
    result = argparse.ArgumentParser(description=description.splitlines()[0])
    result.add_argument("data", type=Path, help="folder of the dataset")
    return result


def add_picture_options(parser: argparse.ArgumentParser, default: str = "all") -> None:
    """--output of a picture, and --subjects that it shows; `default` says which, if left out."""
    parser.add_argument("--output", type=Path, required=True, help="PNG to write")
    parser.add_argument("--subjects", nargs="*", default=[], help=f"ids (default: {default})")


def write(draw: Callable[[Path], None], output: Path) -> int:
    """Draw a picture into a file, or say in one line why there is none; the exit status."""
    try:
        draw(output)
    except (ValueError, OSError) as error:
        return refused(error)
    print(output)
    return 0


def refused(error: Exception) -> int:
    """Say in one line why there is no report; returns the exit status."""
    sys.stderr.write(f"error: {' '.join(str(error).split())}\n")
    return 2
