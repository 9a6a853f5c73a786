"""The times of a process: those planned, and those between them after failures."""

from __future__ import annotations

import math
from collections import deque

from contact_locking.study_file.parameters.numerics import StepParameters

# Steps that differ by less than this share have the same length.
_ROUNDING = 1e-9


class Timeline:
    """The next time to solve at, which comes nearer after a failure.

    ``done`` is the time of the last solution, at first the time before the first step.  A failure
    halves the step; a success between two planned times lets the next step be twice as long.
    """

    def __init__(self, given: StepParameters) -> None:
        self._given = given
        self._planned = deque(given.planned)
        self._interval_start = self.done = given.start
        self._longest = math.inf

    @property
    def is_over(self) -> bool:
        """Whether the last planned time is done."""
        return not self._planned

    @property
    def target(self) -> float:
        """The next time to solve at."""
        planned = self.planned
        is_near = planned - self.done <= self._longest * (1.0 + _ROUNDING)
        return planned if is_near else self.done + self._longest

    @property
    def planned(self) -> float:
        """The next planned time."""
        return self._planned[0]

    @property
    def left(self) -> int:
        """The number of planned times that are left."""
        return len(self._planned)

    def skip_to(self, time: float) -> None:
        """Take the solutions up to a time for done."""
        while self._planned and self._planned[0] <= time:
            self._interval_start = self._planned.popleft()
        self.done = time

    def succeed(self) -> None:
        """The solve at the target has converged."""
        self.done = self.target
        self._longest *= 2.0
        if self.done == self._planned[0]:
            self._interval_start = self._planned.popleft()
            self._longest = math.inf

    @property
    def is_halved(self) -> bool:
        """Whether failures have come between the last planned time and the next."""
        return self._longest < math.inf

    def fail(self, at_limit: bool = False) -> bool:
        """The solve at the target has failed; False if the step must not be halved.

        ``at_limit`` says that a proof excludes the whole step.
        """
        half = 0.5 * (self.target - self.done)
        least = self._given.least_after(self._planned[0] - self._interval_start, at_limit)
        if not half > 0.0 or half < least * (1.0 - _ROUNDING):
            return False
        self._longest = half
        return True
