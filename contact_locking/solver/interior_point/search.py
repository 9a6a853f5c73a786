"""The direction and the length of a step: predictor, corrector, friction bound, recentring."""

from __future__ import annotations

import math
from collections.abc import Sequence

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.solver.interior_point.bound_step import BoundStep, MovingBound
from contact_locking.solver.interior_point.family import Direction
from contact_locking.solver.interior_point.iterate import Iterate
from contact_locking.solver.interior_point.judge import Measures
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.settings import Settings


class Search:
    """The steps 4 to 8 of :mod:`method` for an iterate whose tangent is assembled.

    ``predicts`` is ``trusts_newton`` of the approach.  Methods are collective.
    """

    def __init__(
        self,
        iterate: Iterate,
        bounds: Sequence[MovingBound],
        tuning: Tuning,
        settings: Settings,
        predicts: bool = False,
    ) -> None:
        self._predicts, self.gap_aim = predicts, tuning.gap_aim
        self._iterate, self._bounds = iterate, bounds
        self._tuning, self._tolerance = tuning, settings.tolerance
        self._last_length, self._bounds_contract = 0.0, False
        self._friction_tolerance = settings.friction_tolerance
        self._last_change, self._sharper = math.inf, 1.0

    def step(self, measures: Measures) -> tuple[Direction, float]:
        """The step to take and its length."""
        iterate, tuning = self._iterate, self._tuning
        self._sharpen(measures)
        # The residual of linear solves is a share of the present duality gap, within bounds.
        share = max(tuning.linear_share * measures.gap, tuning.linear_sharpest * self._tolerance)
        self._accuracy = self._sharper * min(share, tuning.linear_loosest)
        # 4. The predictor, whose length determines the target of the products.
        affine = iterate.direction(0.0, self._accuracy)
        t = min(1.0, iterate.longest_step(affine))
        before = iterate.mean_product()
        # On smaller meshes, with a direct solver, ignoring a few cones costs as many tangents as it
        # saves.
        factorises = iterate.tangent.direct is not None
        left_behind = tuning.left_behind
        reach = t if factorises else iterate.longest_step_of_most(affine, left_behind)
        after = iterate.mean_product(reach, affine)
        centring = min(1.0, max(after / before, 0.0)) ** 3
        if self._last_length >= tuning.bolder_after:
            centring *= tuning.bolder
        target = self._limited(centring, measures) * before
        bound_step = BoundStep(self._bounds, iterate.tangent, tuning, self._bounds_contract)
        if self._predicts and measures.gap > tuning.predicted_above:
            bound_step.predict(affine)
        # 5. The corrector.
        trust = min(1.0, t / tuning.trusted_length)
        corrections = trust * iterate.cones.correction(affine.step)
        # 6. The friction bound.
        best = self._with_bounds(bound_step, target, corrections)
        t = self._length(best)
        # 7. Recentring.
        band = tuning.band[0] * target, tuning.band[1] * target
        for _ in range(tuning.recentrings):
            if t >= tuning.long_enough:
                break
            change = -iterate.cones.recentring(min(1.0, t + tuning.reach), best.step, band)
            recentred = iterate.direction(target, self._accuracy, corrections + change)
            candidate, share, longer = self._longest_towards(recentred, best)
            if longer < tuning.gain * t:
                break
            best, corrections, t = candidate, corrections + share * change, longer
        if self._bounds and bound_step.misses(best) > tuning.bound_missed:
            best = self._with_bounds(bound_step, target, corrections, best)
            t = self._length(best)
        self._bounds_contract = bound_step.contracts
        best, self._last_length = self._balanced(best, t, measures)
        return best, self._last_length

    def _balanced(
        self, direction: Direction, t: float, measures: Measures
    ) -> tuple[Direction, float]:
        """The step and its length; a step that may be the last also balances the forces.

        Even unbalanced forces within the tolerance may bend a slender body visibly.
        """
        residual = (1.0 - t) * measures.equilibrium
        if self._iterate.tangent.direct is None:
            residual += t * self._accuracy
        sharpest = self._tuning.linear_sharpest * self._tolerance
        if not (t > 0.0 and sharpest < residual <= self._tolerance):
            return direction, t
        try:
            balanced = self._iterate.balanced(direction, t, min(self._accuracy, sharpest))
        except NotConverged:
            # An iterative solver cannot reduce the rounding in large reactions.
            return direction, t
        shorter = min(t, self._length(balanced))
        is_better = (1.0 - shorter / t) * measures.equilibrium < residual
        return (balanced, shorter) if is_better else (direction, t)

    @property
    def _solves_jointly(self) -> bool:
        """Whether one solve gives a step together with those of the friction bounds."""
        return bool(self._bounds) and self._iterate.tangent.solves_following

    def _with_bounds(
        self,
        bound_step: BoundStep,
        target: float,
        corrections: FloatArray,
        present: Direction | None = None,
    ) -> Direction:
        """The direction together with the steps of the friction bounds that agree with it.

        ``present`` is the direction for the present steps of the bounds, if known.  A joint solve
        with a filter or projection also starts better from it.
        """
        if present is None and (self._iterate.tangent.linear.filters or not self._solves_jointly):
            present = self._iterate.direction(target, self._accuracy, corrections)
        if present is None or self._solves_jointly:
            return self._joint(bound_step, target, corrections)
        return self._adapted(bound_step, present, target, corrections)

    def _joint(self, bound_step: BoundStep, target: float, corrections: FloatArray) -> Direction:
        """As :meth:`_with_bounds`, by one joint solve."""
        iterate, tangent = self._iterate, self._iterate.tangent
        bound_step.reset()
        bound_step.stand(iterate.direction_with(tangent.zeros(), target, corrections))
        aims = iterate.aims(target, corrections)
        du = tangent.solve_following(aims, bound_step.following, self._accuracy)
        if bound_step.follow(du):
            return iterate.direction_with(du, target, corrections)
        return iterate.direction(target, self._accuracy, corrections)

    def _longest_towards(
        self, recentred: Direction, direction: Direction
    ) -> tuple[Direction, float, float]:
        """The direction between this one and the recentred one that has the longest step.

        Returns it with its share of the recentring and its length.  Directions are linear in
        corrections.
        """
        best, share, length = recentred, 1.0, self._length(recentred)
        for smaller in self._tuning.recentring_shares:
            candidate = direction.plus(recentred.plus(direction, -1.0), smaller)
            longer = self._length(candidate)
            if not longer > length:
                break
            best, share, length = candidate, smaller, longer
        return best, share, length

    def _adapted(
        self, bound_step: BoundStep, direction: Direction, target: float, corrections: FloatArray
    ) -> Direction:
        """As :meth:`_with_bounds`, by changing a direction."""
        if not self._bounds or bound_step.agrees(direction):
            return direction
        change = bound_step.adapt(direction)
        # The responses of an iterative solver are too rough to add up.
        if change is not None and self._iterate.tangent.direct is not None:
            moved = direction.displacement + change
            return self._iterate.direction_with(moved, target, corrections)
        return self._iterate.direction(target, self._accuracy, corrections)

    def _length(self, direction: Direction) -> float:
        # 8. Towards the boundary.
        return min(1.0, self._tuning.to_boundary * self._iterate.longest_step(direction))

    def _sharpen(self, measures: Measures) -> None:
        """Make linear solves sharper if only the friction bounds do not converge."""
        tuning, before = self._tuning, self._last_change
        self._last_change = measures.friction
        is_off = measures.friction > self._friction_tolerance
        came_closer = measures.friction <= tuning.bound_closer * before
        if measures.gap <= tuning.gap_tolerance and is_off and not came_closer:
            self._sharper *= tuning.linear_sharper

    def _limited(self, centring: float, measures: Measures) -> float:
        """The centring, limited so that products neither fall far below equilibrium nor vanish."""
        tuning = self._tuning
        if measures.gap < tuning.gap_ahead * measures.equilibrium:
            return 1.0
        least = self.gap_aim * tuning.gap_tolerance / measures.gap
        return max(centring, min(tuning.gap_growth, least))
