"""The time of the nonlinear solve."""

from __future__ import annotations

import math
import time

from contact_locking.monitor import Monitor


class Stopwatch(Monitor):
    """Times the nonlinear solve alone, from its first stage to the fields derived from it."""

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
