"""Rectoverso's command line: each sub-command names a stage and composes it.

Heavy imports wait until their command runs, and Blender and torch stay in worker processes.
"""

from __future__ import annotations

import argparse
import difflib
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal, get_type_hints

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser

    from engine.engines import Means

DONE, FAILURES, WRONG, INTERRUPTED = 0, 1, 2, 130


class WrongCallError(Exception):
    """The call, its configuration or a folder that it names is wrong; the message is one line."""


def main(arguments: list[str] | None = None) -> int:
    """Run one sub-command; returns the exit status.

    0: all done. 1: finished, with failures that were listed. 2: the call or the configuration
    was wrong, or a package is missing. 130: interrupted.
    """
    try:
        return _run(sys.argv[1:] if arguments is None else arguments)
    except ModuleNotFoundError as error:
        package = (error.name or str(error)).partition(".")[0]
        sys.stderr.write(
            f"error: the Python package {package} is missing; in the checkout, "
            "pip install '.[render,humans,trainer,surface,figures,poisson,dask]' brings it, or "
            "`make demo` and then `. .venv/bin/activate`\n"
        )
        return WRONG
    except ImportError as error:
        sys.stderr.write(f"error: {error}\n")
        return WRONG


def _run(given: list[str]) -> int:
    from jsonargparse import ArgumentParser

    commands = {
        "build": (_add_build, _build),
        "verify": (_add_verify, _verify),
        "sweep": (_add_sweep, _sweep),
        "train": (_add_train, _train),
        "reconstruct": (_add_reconstruct, _reconstruct),
        "evaluate": (_add_evaluate, _evaluate),
        "experiment": (_add_experiment, _experiment),
        "report": (_add_report, _report),
    }
    parser = ArgumentParser(
        prog="pipeline.py",
        description=__doc__.splitlines()[0],
        exit_on_error=False,
        allow_abbrev=False,
    )
    choices = parser.add_subcommands(dest="command")
    children = {}
    for name, (add, run) in commands.items():
        summary = (run.__doc__ or "").splitlines()[0]
        children[name] = ArgumentParser(
            description=summary, exit_on_error=False, allow_abbrev=False
        )
        # Only the command that was called pays for the imports of its options.
        if name in given[:1]:
            add(children[name])
        choices.add_subcommand(name, children[name], help=summary)
    try:
        parsed = parser.parse_args(given)
        return commands[parsed.command][1](parser, parsed)
    except (argparse.ArgumentError, WrongCallError) as error:
        sys.stderr.write(f"error: {_explain(error, children, given)}\n")
        return WRONG
    except OSError as error:
        from storage.atomic import NO_ROOM

        if error.errno not in NO_ROOM:
            raise
        sys.stderr.write(
            f"error: {error}; what is finished stands: make room, and run the same command again\n"
        )
        return FAILURES
    except KeyboardInterrupt:
        sys.stderr.write(_INTERRUPTED)
        return INTERRUPTED


_INTERRUPTED = "interrupted; run the same command again to go on\n"


def _on_interrupt(handler: Callable[[int, FrameType | None], Any]) -> None:
    """What Ctrl-C does; a polite end (kill, a batch system's time limit) is the same."""
    signal.signal(signal.SIGINT, handler)
    signal.signal(signal.SIGTERM, handler)


def _end_at_once(number: int, frame: FrameType | None) -> None:
    """While modules are imported: some of them swallow exceptions, and nothing is under way yet."""
    os.write(2, _INTERRUPTED.encode())
    os._exit(INTERRUPTED)


@contextmanager
def _users_errors(
    kinds: tuple[type[Exception], ...] = (ValueError, OSError),
) -> Iterator[None]:
    """Where errors of these kinds speak of what the user gave, not of a fault of ours."""
    from storage.atomic import NO_ROOM

    try:
        yield
    except kinds as error:
        if isinstance(error, OSError) and error.errno in NO_ROOM:
            raise
        raise WrongCallError(str(error)) from error


def _explain(error: Exception, children: dict[str, ArgumentParser], given: list[str]) -> str:
    """What is wrong with a call, in one line: the file and the key first, the cure last."""
    parser = children.get(given[0]) if given else None
    message = str(error)
    # What may also be null is tried as that too: only the first attempt tells something.
    optional = re.search(
        r"Union subtypes.*?Errors:\s+- (\w+\.\w+: .*?)\s+- Expected a <", message, re.DOTALL
    )
    if optional:
        message = optional[1]
    if isinstance(error, argparse.ArgumentError):
        message = _cure(message, parser)
        call = " ".join(["python pipeline.py", *(given[:1] if parser else [])])
        meant = re.search(r"did you mean (\w+)\.\S+ of (\w+)\?", message)
        chosen = meant or re.match(r"(subjects|sensor):\s+(\w+):", message)
        topic = f"--{chosen[1]}.help {chosen[2]}" if chosen else "--help"
        message += f" ({call} {topic} lists what is known)"
    file = _faulty_config(parser, given)
    return " ".join((f"{file}: {message}" if file else message).split())


_KEPT = "build|sweep|train|reconstruct|evaluate|experiment"
"""Where the parser keeps the options of commands."""

_TYPES = {"int": "a whole number", "float": "a number", "str": "text", "bool": "true or false"}

_WORDS = {
    "typing.Literal": "one of ",
    "list[float]": "a list of numbers",
    "PositiveInt": "a whole number above 0",
    "a tuple": "a list of numbers, such as [0.5, 4.5]",
    "tuple": "a list of numbers, such as [0.5, 4.5]",
    "expected list,": "expected a list, such as [100],",
    "expected list[str] or null": "expected a list of ids, such as [open_0000],",
    "Does not validate against any of the Union subtypes": "is none of what it may be",
    '"<unicode string>", ': "",
}


def _cure(message: str, parser: ArgumentParser | None) -> str:
    """A parser's message in a user's words, and with what might have been meant."""
    message = re.sub(r'Parser key "([^"]+)":', r"\1:", message)
    message = re.sub(r"Problem with given class_path '[\w.]*?(\w+)':", r"\1:", message)
    union = re.search(
        r"^((?:[\w.]+:\s+)+).*Subtypes: \[(.*?)\]\n.*Given value: (.*)$", message, re.DOTALL
    )
    if union:
        kinds = re.sub(r"typing\.Literal\[(.*?)\]", r"\1", union[2])
        kinds = kinds.replace("<class 'NoneType'>", "null").replace("NoneType", "null")
        message = f"{union[1]}expected {kinds.replace(', ', ' or ')}, got {union[3]}"
    message = re.sub(r"Expected an? (.*?)\. Got value: (.*)", r"expected \1, got \2", message)
    message = re.sub(r"Expected a dot import path string: (\S+)", r"\1 is no known class", message)
    message = re.sub(r"<class '(?:\w+\.)*(\w+)'>", lambda m: _TYPES.get(m[1], m[1]), message)
    for said, meant in _WORDS.items():
        message = message.replace(said, meant)
    head, required, names = message.partition("are required: ")
    # The parser names the first by its option and the others by where it keeps them.
    message = head + required + re.sub(rf"\b(?:{_KEPT})\.", "--", names.replace("verify.", ""))
    given = r"^(\w+):\s.*NestedArg\(key='(\w+)', val='?(.*?)'?\)"
    nested = re.search(given, message, re.DOTALL)
    if nested and parser is not None:
        hints = get_type_hints(_optional(nested[1]))
        known = ", ".join(f"{name} ({_TYPES[kind.__name__]})" for name, kind in hints.items())
        message = f"{nested[1]}.{nested[2]}: {nested[3]} does not fit; there are {known}"
    if parser is not None:
        message += _suggestion(message, parser)
    if "expected one argument" in message:
        message += "; a value that starts with '-' is written as --key=value"
    return message


def _optional(key: str) -> type:
    """The class that an option has where it is not null."""
    from augment.color_camera import ColorCamera

    return {"color_camera": ColorCamera}[key]


def _suggestion(message: str, parser: ArgumentParser) -> str:
    """What to write instead, where that can be told."""
    unknown = re.search(r"(?:Group '([\w.]+)'.*)?(?:[oO]ption '|arguments: --)([\w.-]+)", message)
    if unknown:
        chosen = re.match(r"(subjects|sensor):\s+(\w+):", message)
        parts = [chosen[1] if chosen else "", unknown[1] or "", unknown[2]]
        return _nearest(".".join(filter(None, parts)), parser, chosen[2] if chosen else "")
    key = message.partition(":")[0]
    key = key.removeprefix("--").removesuffix(".help")
    if "is no known class" in message:
        return f"; known: {', '.join(kind.__name__ for kind in _choices(key))}"
    if key in {action.dest for action in parser._actions}:
        default = parser.get_default(key)
        if isinstance(default, (int, float, str)):
            return f"; give for example {default}"
    return ""


def _nearest(wrong: str, parser: ArgumentParser, used: str) -> str:
    """The option most like `wrong`, dotted, of the parser or of any class; `used` is in use."""
    owners = {action.dest: "" for action in parser._actions}
    if "sensor" in owners:  # the parser of a build
        from engine.config import CHOICES

        for key, kinds in CHOICES.items():
            # Where classes share a name, the one in use has it.
            for kind in sorted(kinds, key=lambda kind: kind.__name__ == used):
                owners |= dict.fromkeys(_options(kind, key), kind.__name__)

    def last(name: str) -> str:
        return name.rpartition(".")[2]

    # A long common beginning alone makes no two names alike.
    words = {last(name) for name in owners}
    alike = difflib.get_close_matches(last(wrong), words, n=len(words), cutoff=0.7)
    candidates = sorted(name for name in owners if last(name) in alike)
    near = difflib.get_close_matches(wrong, candidates, n=1, cutoff=0)
    if not near:
        return ""
    owner = owners[near[0]]
    return f"; did you mean {near[0]}{f' of {owner}' if owner not in ('', used) else ''}?"


def _options(kind: type, prefix: str) -> Iterator[str]:
    """The dotted names of a dataclass's fields, nested ones too."""
    kinds = get_type_hints(kind)
    for field in fields(kind):
        name = f"{prefix}.{field.name}"
        yield name
        if is_dataclass(kinds[field.name]) and isinstance(kinds[field.name], type):
            yield from _options(kinds[field.name], name)


def _choices(key: str) -> tuple[type, ...]:
    """The classes that an option may name."""
    if key == "branch":
        from trainer.branch import Back, Front

        return Front, Back
    from engine.config import CHOICES

    return CHOICES[key]


def _faulty_config(parser: ArgumentParser | None, given: list[str]) -> str | None:
    """The configuration file, where it is wrong after those before it, whatever else is said."""
    named = [after for word, after in pairwise(given) if word == "--config"]
    named += [word.removeprefix("--config=") for word in given if word.startswith("--config=")]
    if parser is None:
        return None
    needed = [a for a in parser._actions if a.required]
    folders = [f"--{a.dest}=." if a.option_strings else (a.choices or ".")[0] for a in needed]
    for count, name in enumerate(named, start=1):
        files = [word for before in named[:count] for word in ("--config", before)]
        try:
            made = parser.instantiate(parser.parse_args([*files, *folders]))
            if given[0] == "sweep":
                from engine.sweep import SweepConfig

                _of(SweepConfig, made)
        except (argparse.ArgumentError, ValueError):
            return name
    return None


def _add_means(parser: ArgumentParser) -> None:
    """What a build or a sweep is given to work with."""
    from jsonargparse.typing import PositiveInt

    from engine.workers import WorkerLimits

    parser.add_argument(
        "--jobs", type=PositiveInt | None, help="worker processes (default: one per processor)"
    )
    parser.add_argument(
        "--engine",
        type=Literal["local", "dask"],
        default="local",
        help="where they run: here, or where Dask has workers",
    )
    parser.add_argument(
        "--scheduler", type=str | None, help="Dask's address (default: one of our own, here)"
    )
    parser.add_class_arguments(WorkerLimits, "limits")


def _means(made: Any) -> Means:
    from engine.engines import Means

    return Means(made.engine, made.scheduler, made.jobs, made.limits)


def _add_build(parser: ArgumentParser) -> None:
    from jsonargparse import set_parsing_settings

    from augment.sensors import Sensor
    from engine.config import BuildConfig
    from engine.configfile import ConfigFile
    from subjects.source import Source

    set_parsing_settings(
        docstring_parse_attribute_docstrings=True, subclasses_enabled=[Sensor, Source]
    )
    parser.add_argument("--config", action=ConfigFile, help="YAML file, see configs/")
    parser.add_argument("--output", type=str, required=True, help="folder or URL of the dataset")
    _add_means(parser)
    parser.add_class_arguments(BuildConfig)
    parser.epilog = (
        "The options of a source or a sensor: --subjects.help Scans, --sensor.help KinectV2."
    )


def _build(parser: ArgumentParser, parsed: Any) -> int:
    """Build a dataset of front/back RGB-D shards, or finish one."""
    from engine.build import build, open_build
    from engine.config import BuildConfig
    from engine.workers import EngineError
    from storage.store import StoreError

    given = parsed.build.as_dict()
    names = [field.name for field in fields(BuildConfig)]
    record = {name: given[name] for name in names}
    with _users_errors():
        made = parser.instantiate(parsed).build
        config = BuildConfig(**{name: made[name] for name in names})
        means = _means(made)
        writer = open_build(config, record, given["output"])
    _on_interrupt(signal.default_int_handler)
    with _users_errors((EngineError, StoreError)), writer:
        return DONE if build(config, writer, means) else FAILURES


def _add_verify(parser: ArgumentParser) -> None:
    parser.add_argument(
        "data",
        type=str,
        help="a dataset's folder or URL, or a sweep's folder",
    )


def _verify(parser: ArgumentParser, parsed: Any) -> int:
    """Prove a dataset again: checksums, schema, and depth against an independent ray cast."""
    from engine.progress import Progress
    from shards.dataset import Dataset
    from shards.proof import Proof
    from shards.sweep import base_folder, is_sweep, read_index
    from shards.verify import verify, verify_sweep

    with _users_errors():
        folder = _data(parsed.verify.data)
        if is_sweep(folder):
            subjects = len(Dataset(base_folder(folder)))
            progress = Progress("verify", subjects * (1 + len(read_index(folder))))
            _on_interrupt(signal.default_int_handler)
            places = [base_folder(folder), *read_index(folder).values()]
            proofs = {os.path.normpath(place): Proof.begin(place) for place in places}
            reports = verify_sweep(folder, progress.step)
            progress.close()
            for place, report in reports.items():
                proofs[os.path.normpath(place)].end(report)
            (base, proof), *powers = reports.items()
            print(f"{base}\n{proof.table()}")
            for name, report in powers:
                print(f"{name}: {report.verdict()}")
            wrong = sum(not report.ok for report in reports.values())
            print(f"{len(reports)} datasets, {wrong or 'none'} of them unsound")
            return FAILURES if wrong else DONE
        progress = Progress("verify", len(Dataset(folder)))
    _on_interrupt(signal.default_int_handler)
    under_way = Proof.begin(folder)
    report = verify(folder, progress.step)
    progress.close()
    under_way.end(report)
    # What is wrong is told of the place that was given, and not of the copy of it here.
    print(report.table().replace(str(folder), parsed.verify.data.rstrip("/")))
    return DONE if report.ok else FAILURES


def _add_sweep(parser: ArgumentParser) -> None:
    from jsonargparse import set_parsing_settings

    from engine.configfile import ConfigFile
    from engine.sweep import SweepConfig

    set_parsing_settings(docstring_parse_attribute_docstrings=True)
    parser.add_argument("--config", action=ConfigFile, help="YAML file, see configs/")
    parser.add_argument("--data", type=str, required=True, help="folder or URL of the dataset")
    parser.add_argument("--output", type=str, required=True, help="folder of the sweep")
    _add_means(parser)
    parser.add_class_arguments(SweepConfig)


def _sweep(parser: ArgumentParser, parsed: Any) -> int:
    """Photograph a dataset under many light powers, from one render of its light."""
    from engine.sweep import Sweep, SweepConfig, sweep

    given = parsed.sweep.as_dict()
    with _users_errors():
        made = parser.instantiate(parsed).sweep
        config, means = _of(SweepConfig, made), _means(made)
        work = Sweep(config, _data(given["data"]), _folder(given["output"]))
    _on_interrupt(signal.default_int_handler)
    with work, _users_errors():
        return DONE if sweep(work, means) else FAILURES


def _add_train(parser: ArgumentParser) -> None:
    from jsonargparse import set_parsing_settings

    from engine.configfile import ConfigFile
    from trainer.branch import Branch
    from trainer.training import TrainConfig

    set_parsing_settings(docstring_parse_attribute_docstrings=True, subclasses_enabled=[Branch])
    parser.add_argument("--config", action=ConfigFile, help="YAML file, see configs/")
    parser.add_argument("--data", type=str, required=True, help="folder or URL of the dataset")
    parser.add_argument("--output", type=str, required=True, help="folder of the training")
    parser.add_argument("--workers", type=int, default=2, help="processes that read views")
    parser.add_argument("--device", type=str, default="cpu", help="where the networks are: cuda")
    parser.add_class_arguments(TrainConfig)
    parser.epilog = "The options of a branch: --branch.help Front, --branch.help Back."


def _train(parser: ArgumentParser, parsed: Any) -> int:
    """Train one branch on a dataset's shards, or go on where it stopped."""
    from shards.archive import ShardError
    from shards.manifest import DatasetError
    from trainer import allocator, processes
    from trainer.checkpoint import CheckpointError
    from trainer.errors import told
    from trainer.training import CHECKPOINT, DivergedError, TrainConfig, Training

    given = parsed.train.as_dict()
    training: Training | None = None
    try:
        with _users_errors():
            made = parser.instantiate(parsed).train
            config = _of(TrainConfig, made)
            folders = _data(given["data"]), _folder(given["output"])
            training = Training(config, *folders, given["workers"], given["device"])
        _on_interrupt(signal.default_int_handler)
        if training.device.type == "cpu":
            allocator.keep()
        figures = training.run()
        if training.is_first:
            print(f"{training.done} epochs in {folders[1] / CHECKPOINT}\ntest {told(figures)}")
    except (CheckpointError, DatasetError, DivergedError, ShardError, OSError) as error:
        # A loader's worker hands on its whole traceback as the message.
        said = str(error).splitlines()[-1].removeprefix(f"{ShardError.__module__}.ShardError: ")
        raise WrongCallError(said) from error
    finally:
        training = None  # what it shares with other processes goes before they part
        processes.leave()
    return DONE


def _add_reconstruct(parser: ArgumentParser) -> None:
    from jsonargparse import set_parsing_settings

    from engine.configfile import ConfigFile
    from engine.frame import FrameFiles
    from engine.reconstruct import Choice, ReconstructConfig

    set_parsing_settings(docstring_parse_attribute_docstrings=True)
    parser.add_argument("--config", action=ConfigFile, help="YAML file")
    parser.add_argument("--data", type=str | None, help="folder or URL of the dataset")
    parser.add_argument(
        "--output", type=str, required=True, help="folder of the meshes; of a frame, its mesh"
    )
    parser.add_argument("--device", type=str, default="cpu", help="where the networks are: cuda")
    parser.add_class_arguments(ReconstructConfig)
    parser.add_class_arguments(Choice)
    parser.add_class_arguments(FrameFiles, "frame")


def _reconstruct(parser: ArgumentParser, parsed: Any) -> int:
    """Make meshes of a dataset's views, or of one capture of a depth camera."""
    from engine.reconstruct import Choice, ReconstructConfig, reconstruct, reconstruct_frame

    given = parsed.reconstruct.as_dict()
    with _users_errors():
        made = parser.instantiate(parsed).reconstruct
        config = _of(ReconstructConfig, made)
        framed = made.frame.rgb is not None or made.frame.depth is not None
        if framed == (given["data"] is not None):
            raise ValueError("give --data, or --frame.rgb and --frame.depth")
        _on_interrupt(signal.default_int_handler)
        output = _folder(given["output"])
        views = _of(Choice, made)
        if framed:
            if views != Choice():
                raise ValueError("split, subjects and views choose of --data; a frame has none")
            if config.format != ReconstructConfig.format:
                raise ValueError("format is that of --data's meshes; a frame's is by --output")
            print(reconstruct_frame(made.frame, output, config, given["device"]))
            return DONE
        done = reconstruct(_data(given["data"]), output, config, views, given["device"])
        return DONE if done else FAILURES


def _add_evaluate(parser: ArgumentParser) -> None:
    from jsonargparse import set_parsing_settings
    from jsonargparse.typing import PositiveInt

    from engine.configfile import ConfigFile
    from engine.evaluate import EvaluateConfig

    set_parsing_settings(docstring_parse_attribute_docstrings=True)
    parser.add_argument("--config", action=ConfigFile, help="YAML file")
    parser.add_argument("--data", type=str, required=True, help="folder or URL of the dataset")
    parser.add_argument("--meshes", type=str, required=True, help="folder of a method's meshes")
    parser.add_argument("--name", type=str, default="ours", help="the method's, in the table")
    parser.add_argument("--output", type=str, required=True, help="folder of the results")
    parser.add_argument("--subjects", type=list[str] | None, help="only meshes of these")
    parser.add_argument(
        "--jobs", type=PositiveInt | None, help="worker processes (default: one per processor)"
    )
    parser.add_class_arguments(EvaluateConfig)


def _evaluate(parser: ArgumentParser, parsed: Any) -> int:
    """Measure a folder of meshes, by whatever method, against a dataset's surfaces."""
    from engine.evaluate import EvaluateConfig, evaluate

    given = parsed.evaluate.as_dict()
    with _users_errors():
        config = _of(EvaluateConfig, parser.instantiate(parsed).evaluate)
        data = _data(given["data"])
        meshes, output = _folder(given["meshes"], "meshes"), _folder(given["output"])
        _on_interrupt(signal.default_int_handler)
        only = given["subjects"]
        found = evaluate(data, meshes, output, given["name"], config, given["jobs"], only)
    for file, why in sorted(found.left_out.items()):
        print(f"left out {file}: {why}", file=sys.stderr)
    print(found.told(config.convention))
    return FAILURES if found.left_out or not found.scores else DONE


def _add_experiment(parser: ArgumentParser) -> None:
    from jsonargparse import set_parsing_settings

    from engine.configfile import ConfigFile
    from experiments.config import ExperimentConfig
    from experiments.run import EXPERIMENTS

    set_parsing_settings(docstring_parse_attribute_docstrings=True)
    parser.add_argument("name", choices=list(EXPERIMENTS), help="table or figure")
    parser.add_argument("--config", action=ConfigFile, help="YAML file, see configs/")
    parser.add_argument("--output", type=str, required=True, help="folder of the study")
    parser.add_class_arguments(ExperimentConfig)


def _experiment(parser: ArgumentParser, parsed: Any) -> int:
    """Run one of the paper's tables or figures on open data, or go on with it."""
    from experiments.config import ExperimentConfig
    from experiments.run import experiment

    given = parsed.experiment.as_dict()
    with _users_errors():
        config = _of(ExperimentConfig, parser.instantiate(parsed).experiment)
        _on_interrupt(signal.default_int_handler)
        print(experiment(given["name"], _folder(given["output"]), config))
    return DONE


def _add_report(parser: ArgumentParser) -> None:
    from jsonargparse.typing import NonNegativeInt, PositiveInt

    parser.add_argument(
        "data",
        type=str,
        help="folder or URL of a dataset; folder of a sweep, an experiment or a training",
    )
    parser.add_argument(
        "--output",
        type=str | None,
        help="the page (default: report.html in the folder; of a URL, here)",
    )
    parser.add_argument(
        "--view",
        type=NonNegativeInt | None,
        help="which view of each subject is shown (default: the one turned least)",
    )
    parser.add_argument(
        "--jobs", type=PositiveInt | None, help="processes that read (default: one per processor)"
    )


def _report(parser: ArgumentParser, parsed: Any) -> int:
    """Show what a folder holds in one HTML file: a dataset, a sweep, an experiment, a training."""
    from report.page.write import NAME, write
    from shards.dataset import Dataset
    from storage.store import is_url

    given = parsed.report
    with _users_errors():
        output = None if given.output is None else _folder(given.output)
        folder = _data(given.data)
        if is_url(given.data):
            Dataset(given.data)  # which brings what the mirror has to have
            output = output or Path(NAME)
        _on_interrupt(signal.default_int_handler)
        print(write(folder, output, given.view, given.jobs))
    return DONE


def _data(place: str) -> Path:
    """The folder of a dataset: its own; or, of one in a store, the mirror of it."""
    from storage.mirror import Mirror
    from storage.store import is_url, local_path

    return Mirror(place).folder if is_url(place) else local_path(place)


def _folder(place: str, option: str = "output") -> Path:
    """The folder that an option names.

    Raises:
        ValueError: it is a URL, which only datasets have.
    """
    from storage.store import is_url, local_path

    if is_url(place):
        raise ValueError(f"{option}: {place} is in a store; give a folder of this machine")
    return local_path(place)


def _of(kind: type, made: Any) -> Any:
    """A dataclass whose fields are options of a command, from what the parser made."""
    return kind(**{field.name: made[field.name] for field in fields(kind)})


if __name__ == "__main__":
    _on_interrupt(_end_at_once)
    # The workers' clean-up helper has nothing to tell a user who pressed Ctrl-C.
    os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker"
    # The checkout is the package: workers find it wherever the command was called from.
    os.environ["PYTHONPATH"] = os.pathsep.join(
        filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")])
    )
    sys.exit(main())
