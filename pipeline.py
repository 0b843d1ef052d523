"""Rectoverso's command line: each sub-command names a stage and composes it.

Heavy imports wait until their command runs, and Blender and torch stay in worker processes.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from pathlib import Path
from typing import Any, NoReturn

from jsonargparse import ActionConfigFile, ArgumentParser, set_parsing_settings
from jsonargparse.typing import PositiveInt

DONE, FAILURES, WRONG = 0, 1, 2


class Parser(ArgumentParser):
    """Says what was wrong with the call in one line."""

    def error(self, message: str, ex: Exception | None = None) -> NoReturn:
        sys.stderr.write(f"error: {_one_line(message)} ({_command(self)} --help lists the keys)\n")
        raise SystemExit(WRONG)


def _command(parser: argparse.ArgumentParser) -> str:
    return f"python {parser.prog}".split(" [")[0]


def _one_line(message: str) -> str:
    """A jsonargparse message without its line breaks and class names, the key first."""
    message = re.sub(r'Parser key "([^"]+)":', r"\1:", message)
    message = re.sub(r"Problem with given class_path '[\w.]*?(\w+)':", r"\1:", message)
    message = re.sub(r"<class '(?:\w+\.)*(\w+)'>", r"\1", message)
    return " ".join(message.split())


def main(arguments: list[str] | None = None) -> int:
    """Run one sub-command; returns the exit status.

    0: all done. 1: finished, with failures that were listed. 2: the call or the configuration
    was wrong.
    """
    commands = {"build": (_add_build, _build), "verify": (_add_verify, _verify)}
    given = sys.argv[1:] if arguments is None else arguments
    parser = Parser(prog="pipeline.py", description=__doc__.splitlines()[0])
    sub = parser.add_subcommands(dest="command")
    for name, (add, run) in commands.items():
        child = Parser(prog=f"pipeline.py {name}", description=(run.__doc__ or "").splitlines()[0])
        # Only the command that was called pays for the imports of its options.
        if name in given[:1]:
            add(child)
        sub.add_subcommand(name, child, help=(run.__doc__ or "").splitlines()[0])
    try:
        parsed = parser.parse_args(given)
        return commands[parsed.command][1](parser, parsed[parsed.command])
    except (ValueError, OSError) as error:
        sys.stderr.write(f"error: {' '.join(str(error).split())}\n")
        return WRONG
    except KeyboardInterrupt:
        sys.stderr.write("interrupted; run the same command again to go on\n")
        return 130


def _add_build(parser: ArgumentParser) -> None:
    import subjects.scans  # makes Scans known as a source
    from engine.config import BuildConfig
    from subjects.source import Source

    set_parsing_settings(docstring_parse_attribute_docstrings=True, subclasses_enabled=[Source])
    parser.add_argument("--config", action=ActionConfigFile, help="YAML file, see configs/")
    parser.add_argument("--output", type=str, required=True, help="folder of the dataset")
    parser.add_argument(
        "--jobs", type=PositiveInt | None, help="worker processes (default: one per processor)"
    )
    parser.add_class_arguments(BuildConfig)


def _build(parser: ArgumentParser, options: Any) -> int:
    """Build a dataset of front/back RGB-D shards, or finish one."""
    from engine.build import build
    from engine.config import BuildConfig

    values = {
        key: value
        for key, value in options.as_dict().items()
        if key not in ("config", "output", "jobs")
    }
    made = parser.instantiate(options)
    config = BuildConfig(**{key: made[key] for key in values})
    whole = build(config, values, Path(options.output), options.jobs)
    return DONE if whole else FAILURES


def _add_verify(parser: ArgumentParser) -> None:
    parser.add_argument("data", type=str, help="folder of the dataset")


def _verify(parser: ArgumentParser, options: Any) -> int:
    """Prove a dataset again: checksums, schema, and depth against an independent ray cast."""
    from shards.verify import verify

    report = verify(Path(options.data))
    print(report.table())
    return DONE if report.ok else FAILURES


if __name__ == "__main__":
    # The checkout is the package: workers find it wherever the command was called from.
    os.environ["PYTHONPATH"] = os.pathsep.join(
        filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")])
    )
    sys.exit(main())
