"""Returns the memory that a solve has freed to the system, before large files are written."""

from __future__ import annotations

import contextlib
import ctypes


def return_freed_memory() -> None:
    """Return the free memory of the C library to the system.

    The GNU C library keeps the memory of matrices and factors, in pieces that are too small for the
    arrays of the fields.  Other C libraries lack the function, and nothing happens.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
