"""Values of numbers and expressions at points, at one time or at the present time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import AXES, FloatArray
from contact_locking.errors import with_key
from contact_locking.expressions import NO_TABLES, TIME, Table, parse
from contact_locking.fields.clock import Clock, LargestSoFar, is_timed
from contact_locking.parallel import agree, maximum


def evaluate(
    comm: MPI.Intracomm,
    value: float | str,
    x: FloatArray,
    key: str,
    infinite: bool = False,
    time: float = 0.0,
    tables: Mapping[str, Table] = NO_TABLES,
) -> FloatArray:
    """A number or an expression of x, y[, z] and t at points (d, k), as (k,); collective.

    Raises InputError with the key on all ranks if a value of any rank is NaN, or infinite without
    ``infinite``.
    """
    expression = parse(value, (*AXES, TIME), allow_infinite=infinite, tables=tables)
    places: dict[str, Any] = dict(zip(AXES, x, strict=False))
    places[TIME] = time
    result = agree(comm, lambda: with_key(key, lambda: expression.numpy(**places)))
    return np.broadcast_to(np.asarray(result, dtype=float), x.shape[1:]).copy()


class PresentValue:
    """The values (k,) of a number or an expression at points (d, k), at the time of a clock.

    ``timed`` says that they depend on the time, and ``key`` names them in messages.  Values that
    are small beside those of earlier times are zero with rounding, as sin(pi*t) is at t = 1: then
    all are zero.  Calls are collective.
    """

    def __init__(self, comm: MPI.Intracomm, value: float | str, key: str, clock: Clock) -> None:
        self._comm, self._value, self.key, self._clock = comm, value, key, clock
        self.expression = parse(value, (*AXES, TIME), tables=clock.tables)
        self.timed = is_timed(self.expression)
        self._so_far = LargestSoFar()

    def __call__(self, x: FloatArray) -> FloatArray:
        clock = self._clock
        found = evaluate(self._comm, self._value, x, self.key, time=clock.now, tables=clock.tables)
        is_zero = self.timed and self._so_far.hides(maximum(self._comm, np.abs(found)))
        return np.zeros_like(found) if is_zero else found
