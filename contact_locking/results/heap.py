"""The memory that a solve has freed, back to the system before large files are written."""

from __future__ import annotations

import contextlib
import ctypes


def give_back() -> None:
    """Return the free memory of the C library to the system.

    The GNU C library keeps what matrices and factors have freed, in pieces that are too small for
    the arrays of the fields.  Other C libraries have no such function, and nothing happens.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
