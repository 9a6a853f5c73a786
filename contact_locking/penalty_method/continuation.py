"""Continuation in n: from soft penalties to those of a problem, in stages of a decade."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from contact_locking.errors import NotConverged
from contact_locking.laws.penalty import Penalty
from contact_locking.solver.task import Target

# The softest penalties: n over the largest eigenvalue of A, and lengths over that of the body.
_SOFT_LOCKING, _SOFT_CONTACT = 10.0, 0.1
# After a failure the step halves; the continuation ends below so many decades.
_SMALLEST = 0.05


@dataclass(frozen=True)
class PenaltyPath:
    """``(n, epsilon, delta)(s)``, 0 <= s <= 1: all geometric, from a soft ``start`` to the ``end``.

    ``decades`` is the longest of the ways in powers of ten.
    """

    start: Penalty
    end: Penalty

    @classmethod
    def towards(cls, target: Target) -> PenaltyPath:
        """From ``n = 10 |A|``, ``epsilon = L/(10 E)`` and ``delta = L/10`` in a body of length L.

        A target that is softer than that is its own start.
        """
        soft = _SOFT_CONTACT * target.length
        count = len(target.penalty.regularisations)
        n, epsilon = _SOFT_LOCKING * target.stiffness, soft / target.young
        return cls.onwards(Penalty(n, epsilon, (soft,) * count), target)

    @classmethod
    def onwards(cls, known: Penalty, target: Target) -> PenaltyPath:
        """From the penalty parameters of a known solution, where the target is beyond them."""
        end = target.penalty
        n, epsilon = min(known.n, end.n), max(known.epsilon, end.epsilon)
        longest = max(known.regularisations, default=0.0)
        return cls(Penalty(n, epsilon, tuple(max(longest, d) for d in end.regularisations)), end)

    @property
    def decades(self) -> float:
        return max(abs(math.log10(end / start)) for start, end in self._ways())

    def at(self, s: float) -> Penalty:
        if s >= 1.0:
            return self.end
        n, epsilon, *deltas = (start * (end / start) ** s for start, end in self._ways())
        return Penalty(n, epsilon, tuple(deltas))

    def _ways(self) -> list[tuple[float, float]]:
        """Start and end of each parameter."""
        sides = ((p.n, p.epsilon, *p.regularisations) for p in (self.start, self.end))
        return list(zip(*sides, strict=True))


def follow(path: PenaltyPath, solve: Callable[[Penalty, bool], None]) -> None:
    """Call ``solve(penalty, is_last)`` along the path, a decade at a time.

    A stage fails by raising NotConverged and leaves the state that it started from; the step is
    then halved.  The last failure is raised where the step has become small.
    """
    step = 1.0 / max(path.decades, 1.0)
    smallest = _SMALLEST * step
    solved, s = 0.0, 0.0 if path.decades > 0.0 else 1.0
    while True:
        # The rest of the way is at least a fifth of a step.
        s = 1.0 if s > 1.0 - 0.2 * step else s
        penalty = path.at(s)
        try:
            solve(penalty, s >= 1.0)
        except NotConverged as failure:
            step = 0.5 * (s - solved)
            if step < smallest:
                where = f"n = {penalty.n:.3g}, epsilon = {penalty.epsilon:.3g}"
                failure.args = (f"{failure} at {where}",)
                raise
            s = solved + step
            continue
        if s >= 1.0:
            return
        solved, s = s, s + step
