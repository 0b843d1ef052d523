"""What the C library does with the memory of large arrays."""

from __future__ import annotations

import ctypes

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_MAX = -1, -2, -4  # of <malloc.h>


def keep() -> None:
    """Keep freed memory for the next array, in place of handing it to the system and asking anew.

    A step of learning makes and frees maps of tens of megabytes, and each page that comes from the
    system is cleared first: a step on whole people takes a quarter less time on two cores. The
    process holds what it needed at most. Nothing happens where the C library is not glibc.
    """
    try:
        change = ctypes.CDLL("libc.so.6").mallopt
    except (OSError, AttributeError):
        return
    change(_MMAP_MAX, 0)
    change(_TRIM_THRESHOLD, 2**31 - 4096)
    change(_TOP_PAD, 2**26)
