"""The times of a process: those planned, and those between them after failures."""

from __future__ import annotations

import math
from collections import deque

from contact_locking.process.settings import Steps
from contact_locking.solver.task import SolverReport

# Steps that differ by less than this share have the same length.
_ROUNDING = 1e-9
# A step may be halved so often, without a least step: less often where a proof says that the body
# cannot follow the whole step.
_HALVINGS, _HALVINGS_AT_LIMIT = 6, 3


class Timeline:
    """The next time to solve at, which comes nearer after a failure.

    ``done`` is the time of the last solution, at first the ``start`` of the steps.  A failure
    halves the step, down to the least one; a success between two planned times lets the next step
    be twice as long.  ``refused`` is the earliest time, since
    the last planned one, at which a proof shows that no displacement is admissible, with the report
    that says so.  ``failed`` has the reasons by the times that failed near it.
    """

    def __init__(self, steps: Steps) -> None:
        self._planned, self._least = deque(steps.planned), steps.least
        self.start = self._interval_start = self.done = steps.start
        self._longest = math.inf
        self.refused: tuple[float, SolverReport] | None = None
        self.failed: dict[float, str] = {}

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
        if self.refused is not None and self.refused[0] <= self.done:
            self.refused = None
        if self.done == self._planned[0]:
            self._interval_start = self._planned.popleft()
            self._longest, self.refused, self.failed = math.inf, None, {}

    @property
    def is_barred(self) -> bool:
        """Whether the target has failed before, or lies behind a time that is refused."""
        refused = self.refused
        return self.target in self.failed or (refused is not None and self.target >= refused[0])

    def refuse(self, time: float, report: SolverReport) -> None:
        """Take a time at which nothing is admissible, as the report says."""
        if self.refused is None or time < self.refused[0]:
            self.refused = time, report

    def fail(self) -> bool:
        """The solve at the target has failed; False if the step must not be halved."""
        half = 0.5 * (self.target - self.done)
        halvings = _HALVINGS if self.refused is None else _HALVINGS_AT_LIMIT
        least = self._least or (self.planned - self._interval_start) / 2**halvings
        if not half > 0.0 or half < least * (1.0 - _ROUNDING):
            return False
        self._longest = half
        return True

    def explained(self, reason: str, at: float, reached: float) -> dict[str, str]:
        """The reason and the suggestion of a process that ends before the refused time.

        Its last step failed to get to the time ``at``, where a solve may fail for a ``reason`` that
        says little, as this is close to the largest load that can be followed.  ``reached`` is the
        time of the last solution, -inf without one.  Empty without a refused time.
        """
        if self.refused is None:
            return {}
        time, report = self.refused
        told = [f"{report.reason}, at t = {time:.6g}"]
        if reached > -math.inf:
            told.append(f"the last time that was reached is t = {reached:.6g}")
        if time > at:
            told.append(f"the step to t = {at:.6g} did not converge: {reason}")
        return {"reason": "; ".join(told), "suggestion": report.suggestion}
