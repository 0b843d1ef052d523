"""What every source of subjects offers: names first, surfaces when asked."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path

from subjects.subject import Subject


class Source(ABC):
    """Where surfaces come from. A source is its own configuration (a frozen dataclass)."""

    @property
    def packages(self) -> tuple[str, ...]:
        """What the surfaces' bytes depend on beside this project; their versions are kept."""
        return ()

    @property
    def loads_torch(self) -> bool:
        """Whether `make` does; Blender then needs another process."""
        return True

    @abstractmethod
    def ids(self) -> list[str]:
        """The subjects' ids, at once and without making any.

        Raises:
            ValueError: there is nothing to make subjects from.
        """

    @abstractmethod
    def make(self, subject: str, seed: int, folder: Path) -> Subject:
        """Make or find one subject, its files below `folder`; runs in a worker process.

        Raises:
            MeshError: the surface cannot be used.
        """

    def refused(self) -> dict[str, str]:
        """What is no subject but looks as if it should be: id -> the reason, one line."""
        return {}

    def refuse_output(self, output: Path) -> None:  # noqa: B027
        """Raise ValueError where a dataset at `output` would disturb the source."""

    def preparation(self) -> str | None:
        """What the first subject has to wait for, if anything: one line for the user."""
        return None

    def papers(self) -> dict[str, str]:
        """What lies beside the subjects, file name -> text: a licence, a card."""
        return {}
