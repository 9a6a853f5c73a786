"""The limits of the strain on the mesh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dolfinx import fem

from contact_locking.errors import InputError
from contact_locking.laws.limits import StrainBall, StrainLimit
from contact_locking.problem.points import InCells, Placed, Points
from contact_locking.problem.strain_sets import Limited, Sampler
from contact_locking.values.concept import marked
from contact_locking.values.kinds import ScalarRule
from contact_locking.values.value import Value

# A limit of some cells alone is none elsewhere; vectors and matrices are zero there.
_ELSEWHERE = {"at_most": math.inf, "at_least": -math.inf}


@dataclass(frozen=True)
class LimitsOnMesh:
    """All limits of a problem at the points of the strains.

    ``ball`` is the ball of the paper, with M = inf where none is given, and ``others`` are the
    other sets.  ``limit`` is M of the ball in the space of strains, and ``limit_at_peaks`` is M
    where the strain of a cell is largest (`Element.at_peaks`).
    """

    points: Points
    ball: Limited
    others: Sequence[Limited]
    limit: fem.Function
    limit_at_peaks: fem.Function
    peaks: Sequence[tuple[Points, Sampler]] = ()

    @classmethod
    def of(cls, points: Points, given: Sequence[Placed]) -> LimitsOnMesh:
        """The limits at the points; collective.

        Raises InputError for more than one ball, and for limits that are not positive.
        """
        limits = _joined(given)
        balls = [(key, item) for key, item in limits if isinstance(item, StrainBall)]
        if len(balls) > 1:
            raise InputError("has more than one StrainBall; take the smaller limit", balls[1][0])
        key, ball = balls[0] if balls else ("limits", StrainBall(Value(math.inf)))
        others = [
            one for key, item in limits if item is not ball for one in item.on(points.seen(key))
        ]
        (of_ball,) = ball.on(points.seen(key))
        limit = at_peaks = points.function()
        peaks = []
        if points.element.at_peaks is not points.element:
            there = Points(points.domain, points.element.at_peaks, points.clock)
            at_peaks = there.function()
            limits_there = there.seen(key).positive(ball.at_most, "at_most", "the locking limit")
            peaks.append((there, limits_there))
        found = cls(points, of_ball, others, limit, at_peaks, peaks)
        found.write()
        return found

    def refresh(self) -> None:
        """Take the present values of all limits; collective."""
        for item in (self.ball, *self.others):
            item.refresh()
        self.write()

    def write(self) -> None:
        """Put M of the ball into the functions; collective."""
        self.points.write(self.limit, self.ball.limits)
        for points, limits in self.peaks:
            points.write(self.limit_at_peaks, limits())


def _joined(given: Sequence[Placed]) -> list[tuple[str, Any]]:
    """The limits with their keys, those of which a body has one joined over their cells."""
    groups: dict[Any, list[Placed]] = {}
    for number, item in enumerate(given):
        is_shared = item.cells is not None and item.given.once
        groups.setdefault(type(item.given) if is_shared else number, []).append(item)
    return [(group[0].key, _in_cells(group)) for group in groups.values()]


def _in_cells(group: Sequence[Placed]) -> Any:
    """One limit with the values of all in their cells."""
    first, found = group[0].given, {}
    kind: type[StrainLimit] = type(first)
    for name in marked(kind, ScalarRule) if group[0].cells is not None else ():
        parts = [Placed(getattr(p.given, name), p.key_of(name), p.cells) for p in group]
        found[name] = Value(InCells(parts, _ELSEWHERE.get(name, 0.0)))
    return first.model_copy(update=found) if found else first
