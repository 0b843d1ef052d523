"""What a build left of one open human."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shards.dataset import SUBJECTS, Dataset

ASPECTS = ("body", "pose", "outfit", "look")

_WITH_THIRD = ("stripes", "tartan", "flowers", "jacquard")


@dataclass(frozen=True)
class Garment:
    """A garment as it was measured.

    Attributes:
        through_share: of its area, inside the body.
        freed_share: of its area, inside the body before it was laid back on the skin; None where
            the build did not tell.
        fold_deg: how far its surface turns from one place to the next; None if others hide it.
    """

    kind: str
    through_share: float
    freed_share: float | None
    fold_deg: float | None
    soft_and_loose: bool


@dataclass(frozen=True)
class Human:
    """What is read of one human.

    Attributes:
        aspects: of `ASPECTS`, the draws that show: dotted name -> value.
        cloth: "draped" or "laid"; None where the build did not tell.
        failed: why earlier draws of it were thrown away.
        prints: SHA-256 of its surface and of its texture.
        seconds: that making it took.
        peak_memory_mb: that its worker had at most.
    """

    subject: str
    pose: str
    hard: bool
    triangles: int
    aspects: dict[str, dict[str, Any]]
    cloth: str | None
    garments: tuple[Garment, ...]
    failed: tuple[str, ...]
    prints: dict[str, str]
    seconds: float
    peak_memory_mb: float


def pose_of(body: Mapping[str, Any]) -> tuple[str, bool]:
    """A pose's name, "-" if there is none, and whether it is a hard one.

    Args:
        body: the parametric body's parameters, as a shard or parameters.json has them.
    """
    pose = body.get("pose", "-")
    if isinstance(pose, Mapping):
        return str(pose.get("name", "-")), bool(pose.get("hard", False))
    return str(pose), bool(body.get("hard", False))


def read_human(dataset: Dataset, subject: str) -> Human:
    """What a build left of an open human.

    Raises:
        ValueError: one of its files is missing, or no open human's; it says which.
    """
    mesh = dataset.path(dataset.shard(subject).meta["mesh"])
    folder = dataset.folder / SUBJECTS / subject
    path = folder / "cost.json"
    try:
        cost = json.loads(path.read_text(encoding="utf-8"))
        seconds, memory = float(cost["seconds"]), float(cost["peak_memory_mb"])
        path = folder / "parameters.json"
        parameters = json.loads(path.read_text(encoding="utf-8"))
        body, drapes, outfit = (parameters[key] for key in ("body", "drapes", "outfit"))
        pose, hard = pose_of(body)
        aspects = {
            "body": {key: body[key] for key in ("age_years", "height_m", "phenotype")},
            "pose": {key: body[key] for key in ("pose", "pose_parameters")},
            "outfit": outfit,
            "look": shown(parameters["look"], outfit),
        }
        human = Human(
            subject=subject,
            pose=pose,
            hard=hard,
            triangles=int(parameters["triangles"]),
            aspects={key: dict(_leaves(value)) for key, value in aspects.items()},
            cloth=drapes.get("cloth"),
            garments=tuple(_garment(measured) for measured in drapes["garments"]),
            failed=tuple(str(reason) for reason in drapes["failed"]),
            prints={"surface": _sha256(mesh), "texture": _texture_sha256(mesh.parent)},
            seconds=seconds,
            peak_memory_mb=memory,
        )
    except OSError as error:
        raise ValueError(_cure(Path(error.filename or path), "cannot be read", folder)) from None
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        what = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(_cure(path, f"is no open human's ({what})", folder)) from None
    return human


def _cure(path: Path, fault: str, folder: Path) -> str:
    return f"{path} {fault}; delete {folder} and build the subject again"


def _garment(measured: Mapping[str, Any]) -> Garment:
    freed, fold = measured.get("freed_share"), measured["fold_deg"]
    return Garment(
        kind=str(measured["garment"]),
        through_share=float(measured["through_share"]),
        freed_share=None if freed is None else float(freed),
        fold_deg=None if fold is None else float(fold),
        soft_and_loose=bool(measured["soft_and_loose"]),
    )


def shown(look: Mapping[str, Any], outfit: Mapping[str, Any]) -> dict[str, Any]:
    """Of a look, what shows on the outfit: no seeds, no colours of what is not worn.

    Args:
        look: as parameters.json has it.
        outfit: likewise.
    """
    top, bottom, outer = (outfit.get(where) or {} for where in ("top", "bottom", "outer"))
    fronts = {garment.get("front") for garment in (top, outer)}
    hat = look.get("headwear", "none")
    printed = top.get("front") == "print" or (outer or top).get("back") == "print"
    # A top that hangs over the waistband hides the belt.
    belt = bottom.get("belt") and (top.get("tucked") or top["hem"] > bottom["waist"])
    there = {
        "front_print": False,
        "back_print": False,
        "lining": False,
        "headwear_fabric": hat != "none",
        "headwear_motif": hat == "cap",
        "bottom": bottom,
        "outer": outer,
        # Of other tops the collar is of the top's own cloth.
        "collar": top.get("kind") in ("tee", "sweater", "hoodie"),
        "motif": printed,
        "motif_second": printed or hat == "cap",
        "buttons": "buttons" in fronts,
        "metal": belt or "zip" in fronts,
        "belt": belt,
        "laces": outfit.get("footwear") != "boots" or top.get("back") == "hood",
        "shoe_panels": outfit.get("footwear") != "leather",
    }
    return {
        name: _fabric(value) if isinstance(value, Mapping) else value
        for name, value in look.items()
        if there.get(name, True)
    }


def _fabric(fabric: Mapping[str, Any]) -> dict[str, Any]:
    """Of a cloth, the colours that its pattern has."""
    pattern, denim = fabric.get("pattern"), fabric.get("weave") == "twill"
    there = {
        "second": denim or pattern != "plain",
        "third": pattern in _WITH_THIRD,
        "repeat": pattern != "plain",
        "wear": denim,
    }
    return {name: value for name, value in fabric.items() if there.get(name, True)}


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """{"a": {"b": 1}, "c": [2]} -> ("a.b", 1), ("c.0", 2)."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from _leaves(inner, f"{name}.{k}")
    elif value is not None:
        yield name, value


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _texture_sha256(folder: Path) -> str:
    pictures = sorted(folder.glob("*.jpeg"))
    return hashlib.sha256("".join(_sha256(p) for p in pictures).encode()).hexdigest()
