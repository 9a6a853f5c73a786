"""The time of the nonlinear solve."""

from __future__ import annotations

import math
import time

from mpi4py import MPI

from contact_locking.monitor import Monitor


class Stopwatch(Monitor):
    """The CPU time of the nonlinear solve alone, from its first stage to the derived fields."""

    def __init__(self) -> None:
        self._began = self._ended = math.nan

    @property
    def seconds(self) -> float:
        return self._ended - self._began

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        if index == 1:
            self._began = time.process_time()

    def message(self, text: str) -> None:
        self._ended = time.process_time()


class WallClock(Stopwatch):
    """The nonlinear solve alone on all ranks, by the clock on the wall."""

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        if math.isnan(self._began):
            MPI.COMM_WORLD.Barrier()
            self._began = time.perf_counter()

    def message(self, text: str) -> None:
        if math.isnan(self._ended) and not math.isnan(self._began):
            MPI.COMM_WORLD.Barrier()
            self._ended = time.perf_counter()
