"""Values at points, at one time or at the present time."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.errors import with_key
from contact_locking.fields.clock import Clock, LargestSoFar
from contact_locking.parallel import agree, maximum
from contact_locking.values.value import Value


def evaluate(
    comm: MPI.Intracomm, value: Value, x: FloatArray, key: str, time: float = 0.0
) -> FloatArray:
    """The values (k,) at points (d, k) and a time; collective.

    Raises InputError with the key on all ranks if a value of any rank is not finite.
    """
    return agree(comm, lambda: with_key(key, lambda: value.at(x, time)))


class PresentValue:
    """The values (k,) of a value at points (d, k), at the time of a clock.

    ``key`` names it in messages.  Values that are small beside those of earlier times are zero with
    rounding, as sin(pi*t) is at t = 1: then all are zero.  Calls are collective.
    """

    def __init__(self, comm: MPI.Intracomm, value: Value, key: str, clock: Clock) -> None:
        self._comm, self.value, self.key, self._clock = comm, value, key, clock
        self._so_far = LargestSoFar()

    def __call__(self, x: FloatArray) -> FloatArray:
        found = evaluate(self._comm, self.value, x, self.key, self._clock.now)
        is_timed = self.value.is_timed
        is_zero = is_timed and self._so_far.hides(maximum(self._comm, np.abs(found)))
        return np.zeros_like(found) if is_zero else found
