"""The time of the nonlinear solve."""

from __future__ import annotations

import math
import time

from mpi4py import MPI

from contact_locking.solver.monitor import Monitor


class Stopwatch(Monitor):
    """The CPU time of the nonlinear solve alone, from its first stage to the derived fields.

    The first message after the first stage says that the fields are computed.  Warnings follow it.
    """

    def __init__(self) -> None:
        self._began = self._ended = math.nan

    @property
    def seconds(self) -> float:
        return self._ended - self._began

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        if math.isnan(self._began):
            self._began = self._now()

    def message(self, text: str) -> None:
        if math.isnan(self._ended) and not math.isnan(self._began):
            self._ended = self._now()

    def _now(self) -> float:
        return time.process_time()


class WallClock(Stopwatch):
    """The nonlinear solve alone on all ranks, by the clock on the wall."""

    def _now(self) -> float:
        MPI.COMM_WORLD.Barrier()
        return time.perf_counter()
