"""What a licence allows: whether a dataset may be passed on."""

from __future__ import annotations

_REDISTRIBUTABLE = frozenset(
    {
        *("CC0-1.0", "PDDL-1.0", "MIT", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause"),
        *("CC-BY-3.0", "CC-BY-4.0", "CC-BY-SA-3.0", "CC-BY-SA-4.0", "ODC-By-1.0", "ODbL-1.0"),
        *("CC-BY-NC-4.0", "CC-BY-NC-SA-4.0"),
    }
)
"""SPDX identifiers under which renders of a surface may be shared, on the licence's terms."""


def is_redistributable(licence: str) -> bool:
    """Whether `licence` is known to let derived data be shared; what is unknown does not."""
    return licence in _REDISTRIBUTABLE


def licence_url(licence: str) -> str:
    """The SPDX page of a known identifier; any other licence is its own name."""
    return f"https://spdx.org/licenses/{licence}.html" if licence in _REDISTRIBUTABLE else licence
