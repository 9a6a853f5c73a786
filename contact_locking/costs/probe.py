"""The speed of this machine, by pieces of work like those of a solve, and its memory."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from contact_locking.costs.reference import REFERENCE, Reference

# Each piece of work takes about 1 ms.
_SIZE, _PRODUCTS = 160, 8
_VALUES, _JUMP = 400_000, 161_803
# The least of several times, as other work on the machine only adds to the time.
_TIMES = 3
# Where a container limits its memory, by the version of control groups.
_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


def speed(reference: Reference = REFERENCE) -> float:
    """How many times as fast as the machine of the reference this core is, by a short probe.

    A factorisation is products of dense blocks, as far as its time grows faster than the number of
    unknowns; assembly and substitutions wait for the memory.  Both halves count equally.
    """
    square = np.cos(np.arange(_SIZE**2)).reshape(_SIZE, _SIZE)
    # All places, in an order that jumps; NumPy's random numbers would take 10 ms to import.
    values = np.arange(float(_VALUES))
    places = np.arange(_VALUES) * _JUMP % _VALUES

    def products() -> None:
        for _ in range(_PRODUCTS):
            square @ square

    product, gather = _least(products), _least(lambda: values[places])
    return 2.0 / (product / reference.product + gather / reference.gather)


def _least(work: Callable[[], object]) -> float:
    """The CPU seconds of ``work``, with the threads of its libraries."""
    found = []
    for _ in range(_TIMES):
        began = time.process_time()
        work()
        found.append(time.process_time() - began)
    return max(min(found), 1e-6)


def memory() -> float | None:
    """The bytes of this machine, or of the container it is; None where nobody says."""
    known = []
    # Not every system knows its pages; without a limit the file says "max", or there is none.
    with contextlib.suppress(ValueError, OSError):
        known.append(float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")))
    for place in _LIMITS:
        with contextlib.suppress(ValueError, OSError):
            known.append(float(Path(place).read_text(encoding="ascii")))
    return min(known, default=None)
