"""Any folder of scans as a source of subjects, with the bodies fitted to them; see `Scans`."""

from subjects.scans.source import Scans

__all__ = ["Scans"]
