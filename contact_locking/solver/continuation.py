"""The path from a soft penalty to the one asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from contact_locking.errors import NotConverged
from contact_locking.solver.target import Target

# n, epsilon, and the regularisation of friction.
Penalties: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class PenaltyPath:
    """``(n, eps, delta)(s)`` for s in [0, 1], all geometric, from a soft ``start`` to the ``end``.

    ``delta`` is the regularisation of friction.  ``decades`` is the longest of the three ways in
    powers of ten.
    """

    start: Penalties
    end: Penalties

    @classmethod
    def towards(cls, target: Target) -> PenaltyPath:
        """From ``n = 10 stiffness``, ``eps = length/(10 E)`` and ``delta = length/10``.

        A target that is softer than that is its own start.
        """
        soft = 0.1 * target.length
        return cls.onwards(10.0 * target.stiffness, soft / target.young, soft, target)

    @classmethod
    def onwards(
        cls, n: float, epsilon: float, regularisation: float, target: Target
    ) -> PenaltyPath:
        """From the penalties of a known solution, where the target is beyond them."""
        end = target.n, target.epsilon, target.regularisation
        return cls((min(n, end[0]), max(epsilon, end[1]), max(regularisation, end[2])), end)

    @property
    def decades(self) -> float:
        pairs = zip(self.start, self.end, strict=True)
        return max(abs(math.log10(end / start)) for start, end in pairs)

    def at(self, s: float) -> Penalties:
        if s >= 1.0:
            return self.end
        n, epsilon, regularisation = (
            start * (end / start) ** s for start, end in zip(self.start, self.end, strict=True)
        )
        return n, epsilon, regularisation


def follow(
    path: PenaltyPath, stage: Callable[[Penalties, bool], None], smallest: float = 0.05
) -> None:
    """Call ``stage(penalties, last)`` along the path, a decade at a time, halving after a failure.

    A stage fails by raising NotConverged and must leave the state it started from.  The failure
    is passed on once the step has shrunk to ``smallest`` decades.  A path of no length has one
    stage, the last.
    """
    if path.decades == 0.0:
        stage(path.end, True)
        return
    step = 1.0 / max(path.decades, 1.0)
    limit = smallest * step
    done, target = 0.0, 0.0
    while True:
        # A remainder of less than a fifth of a step is not worth a stage of its own.
        target = 1.0 if target > 1.0 - 0.2 * step else target
        penalties = path.at(target)
        try:
            stage(penalties, target >= 1.0)
        except NotConverged as failure:
            step = 0.5 * (target - done)
            if step < limit:
                n, epsilon, _ = penalties
                raise NotConverged(f"{failure} at n = {n:.3g}, epsilon = {epsilon:.3g}") from None
            target = done + step
            continue
        if target >= 1.0:
            return
        done, target = target, target + step
