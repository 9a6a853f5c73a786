"""The path from a soft penalty to the one asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from contact_locking.errors import NotConverged
from contact_locking.solver.target import Target


@dataclass(frozen=True)
class PenaltyPath:
    """``n(s)`` and ``eps(s)`` for s in [0, 1], both geometric, from a soft start to the target.

    ``decades`` is the longer of the two ways in powers of ten.
    """

    n_start: float
    n_end: float
    epsilon_start: float
    epsilon_end: float

    @classmethod
    def towards(cls, target: Target) -> PenaltyPath:
        """From ``n = 10 stiffness`` and ``eps = length/10``, where the target is beyond them."""
        n, epsilon = target.n, target.epsilon
        return cls(min(n, 10.0 * target.stiffness), n, max(epsilon, 0.1 * target.length), epsilon)

    @classmethod
    def onwards(cls, n: float, epsilon: float, target: Target) -> PenaltyPath:
        """From the penalties of a known solution, where the target is beyond them."""
        return cls(min(n, target.n), target.n, max(epsilon, target.epsilon), target.epsilon)

    @property
    def decades(self) -> float:
        return max(
            math.log10(self.n_end / self.n_start), math.log10(self.epsilon_start / self.epsilon_end)
        )

    def at(self, s: float) -> tuple[float, float]:
        if s >= 1.0:
            return self.n_end, self.epsilon_end
        n = self.n_start * (self.n_end / self.n_start) ** s
        return n, self.epsilon_start * (self.epsilon_end / self.epsilon_start) ** s


def follow(
    path: PenaltyPath, stage: Callable[[float, float, bool], None], smallest: float = 0.05
) -> None:
    """Call ``stage(n, eps, last)`` along the path, a decade at a time, halving after a failure.

    A stage fails by raising NotConverged and must leave the state it started from.  The failure
    is passed on once the step has shrunk to ``smallest`` decades.  A path of no length has one
    stage, the last.
    """
    if path.decades == 0.0:
        stage(path.n_end, path.epsilon_end, True)
        return
    step = 1.0 / max(path.decades, 1.0)
    limit = smallest * step
    done, target = 0.0, 0.0
    while True:
        # A remainder of less than a fifth of a step is not worth a stage of its own.
        target = 1.0 if target > 1.0 - 0.2 * step else target
        n, epsilon = path.at(target)
        try:
            stage(n, epsilon, target >= 1.0)
        except NotConverged as failure:
            step = 0.5 * (target - done)
            if step < limit:
                raise NotConverged(f"{failure} at n = {n:.3g}, epsilon = {epsilon:.3g}") from None
            target = done + step
            continue
        if target >= 1.0:
            return
        done, target = target, target + step
