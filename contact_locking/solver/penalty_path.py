"""The way from soft penalties to those of a problem, in stages that halve after a failure."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from contact_locking.errors import NotConverged
from contact_locking.laws.penalty import Penalty
from contact_locking.solver.task import Target


@dataclass(frozen=True)
class PenaltyPath:
    """``(n, eps, delta)(s)`` for s in [0, 1], all geometric, from a soft ``start`` to the ``end``.

    ``delta`` is the regularisation of friction.  ``decades`` is the longest of the ways in powers
    of ten.
    """

    start: Penalty
    end: Penalty

    @classmethod
    def towards(cls, target: Target) -> PenaltyPath:
        """From ``n = 10 stiffness``, ``eps = length/(10 E)`` and ``delta = length/10``.

        A target that is softer than that is its own start.
        """
        soft = 0.1 * target.length
        count = len(target.penalty.regularisations)
        start = Penalty(10.0 * target.stiffness, soft / target.young, (soft,) * count)
        return cls.onwards(start, target)

    @classmethod
    def onwards(cls, known: Penalty, target: Target) -> PenaltyPath:
        """From the penalty parameters of a known solution, where the target is beyond them."""
        end, smooth = target.penalty, known.regularisations
        if len(smooth) != len(end.regularisations):
            smooth = (max(smooth, default=0.0),) * len(end.regularisations)
        pairs = zip(smooth, end.regularisations, strict=True)
        n, epsilon = min(known.n, end.n), max(known.epsilon, end.epsilon)
        return cls(Penalty(n, epsilon, tuple(max(pair) for pair in pairs)), end)

    @property
    def decades(self) -> float:
        return max(abs(math.log10(end / start)) for start, end in self._ways())

    def at(self, s: float) -> Penalty:
        if s >= 1.0:
            return self.end
        n, epsilon, *regularisations = (start * (end / start) ** s for start, end in self._ways())
        return Penalty(n, epsilon, tuple(regularisations))

    def _ways(self) -> list[tuple[float, float]]:
        """Start and end of each parameter."""
        sides = ((p.n, p.epsilon, *p.regularisations) for p in (self.start, self.end))
        return list(zip(*sides, strict=True))


def follow(
    path: PenaltyPath, stage: Callable[[Penalty, bool], None], smallest: float = 0.05
) -> None:
    """Call ``stage(penalty, last)`` along the path, a decade at a time, halving after a failure.

    A stage fails by raising NotConverged and must leave the state it started from.  The failure
    is passed on once the step has shrunk to ``smallest`` decades.
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
        penalty = path.at(target)
        try:
            stage(penalty, target >= 1.0)
        except NotConverged as failure:
            step = 0.5 * (target - done)
            if step < limit:
                where = f"n = {penalty.n:.3g}, epsilon = {penalty.epsilon:.3g}"
                failure.args = (f"{failure} at {where}",)
                raise
            target = done + step
            continue
        if target >= 1.0:
            return
        done, target = target, target + step
