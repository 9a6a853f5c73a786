"""A primal-dual interior point method for the contact problem, for any n up to infinity.

For given friction bounds the problem is a second-order cone programme.  Its cones are small and
many, one per point of a cell and two per node of Gamma_C, so each is eliminated where it stands
and what is left is an elasticity system in the displacement.  The friction bounds take part in
every step by Newton's method (:mod:`bound_step`), so that the non-local problem costs few
back-substitutions more than one with known bounds.

1. Start: the elastic displacement (:mod:`start`).  If it is admissible and rubs nowhere, it is the
   solution.  Else each family of cones puts its points near the central path around it.
2. Measure equilibrium, the laws, the duality gap and the friction bound (:mod:`judge`); stop at
   the tolerances, or with a proof that nothing is admissible (:mod:`farkas`).  Where the
   pieces of the laws do not finish a penalised solution, go on until each locking stress keeps
   its law.  Where rounding has unbalanced the forces, or makes the tangent of 3 singular, bound
   the stiffness of the steps that follow.
3. Linearise: scale each cone by Nesterov and Todd (doi:10.1287/moor.22.1.1), eliminate it, and
   assemble and factorise the tangent.  Everything up to 8 uses that factorisation.
4. Predictor: the direction towards products of zero; it foresees the step of the friction bound.
5. Corrector: the direction towards the products that the predictor makes likely, with its
   second-order terms (Mehrotra, doi:10.1137/0802028).
6. Friction bound: its step that agrees with the direction, and the direction with that.
7. Recentring: while a step is short, correct the products that it would drive out of their band
   (Gondzio, doi:10.1007/BF00249643); then 6 once more if the bound has been left behind.
8. Step towards the boundary of the cones; if it may be the last, balance the forces with it.
9. Follow the friction bound: if the step hardly brought it closer to ``mu |R p|``, set it to that.
   Go on with 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.errors import Infeasible, NotConverged, raise_callback_error
from contact_locking.solver.interior_point.active_set import ActiveSet
from contact_locking.solver.interior_point.bound_step import BoundLaw
from contact_locking.solver.interior_point.family import Direction, Reaction
from contact_locking.solver.interior_point.farkas import excluded_factor
from contact_locking.solver.interior_point.iterate import Iterate, families_of
from contact_locking.solver.interior_point.judge import Judge, Measures
from contact_locking.solver.interior_point.search import Search
from contact_locking.solver.interior_point.start import ElasticStart, rests
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.interior_point.tuning import CLOSE, Approach, Tuning
from contact_locking.solver.ksp import linear_failures
from contact_locking.solver.task import Multipliers, Outcome, SavedState, Task


class InteriorPoint:
    """Solves from a cold start: a previous case, on the boundary of its cones, is no better.

    ``bound_moves`` lets the friction bounds follow the pressure; otherwise they stay as they are.
    ``share`` is that of the friction that acts.
    """

    def __init__(
        self,
        task: Task,
        approach: Approach = CLOSE,
        bound_moves: bool = True,
        share: float = 1.0,
    ) -> None:
        self._task, self._approach, self.bound_moves = task, approach, bound_moves
        self._tuning = tuning = Tuning()
        self._families = families_of(task.system, task.target, tuning.least_bound, share)
        self._tangent = Tangent(task, self._families.every, tuning)
        self._iterate = Iterate(self._tangent, tuning.band)
        self._search = Search(self._iterate, [], tuning, task.settings)
        self._judge = Judge(task, self._tangent, tuning)
        #: Whether the elastic displacement alone is the solution.
        self.is_elastic = False
        self._pieces: ActiveSet | None = None
        self._first: tuple[float, float] | None = None
        self._is_from_saved = False

    def solve(self, last: SavedState | None = None, by_pieces_alone: bool = False) -> Outcome:
        """Iterate to the tolerances; raises NotConverged, the best iterate left in place.

        ``last`` is a solution that may be near, such as that of the step before.
        """
        # A NaN is found where steps and residuals are judged.
        with np.errstate(all="ignore"):
            return self._solved(self._iterate_to_the_end(last, by_pieces_alone))

    def _solved(self, gap: float) -> Outcome:
        return Outcome.solved(
            self.multipliers(),
            last=self._last(),
            duality_gap=gap,
            friction_change=self.friction_change,
            from_saved=self._is_from_saved,
        )

    @property
    def friction_change(self) -> float:
        return self._judge.friction_change

    def finish(self, found: Outcome) -> Outcome:
        """A solution of the cones to its last digits, by the pieces of the laws; collective.

        Cones leave locking stresses, smooth friction and penalised solutions rough.  A solution is
        as it was where linear solves are iterative, and where that method does not arrive.
        """
        if self._pieces is not None or found.last is None:
            return found
        penalty = self._task.target.penalty
        is_rough = bool(self._families.strains) or self._judge.leaves_gap
        if penalty.is_strict and not is_rough and not any(penalty.regularisations):
            return found
        return self._by_pieces(found.last) or found

    def rescue(self) -> Outcome | None:
        """The solution that the pieces of the laws lead to from where a solve failed; collective.

        None where they do not arrive.
        """
        return self._by_pieces(self._last()) if self._iterate.is_finite else None

    def _by_pieces(self, last: SavedState) -> Outcome | None:
        """The solution that the pieces of the laws lead to from an iterate; collective.

        None where they do not arrive, where linear solves are iterative, and for an elastic body.
        """
        if self.is_elastic or self._tangent.direct is None:
            return None
        pieces = self._all_pieces()
        with np.errstate(all="ignore"):
            if not self._take(pieces, pieces.from_last(last)):
                return None
        return self._solved(self._gap)

    def multipliers(self) -> Multipliers:
        """The multipliers of the present iterate; collective."""
        system = self._task.system
        found = Multipliers.zero(system)
        if not self.is_elastic:
            for family in self._iterate.families:
                family.write(found, self._task.target.young)
            found.add_up(system.data)
        return found

    def linearised_bounds(self) -> list[BoundLaw]:
        """The laws of all friction bounds, linearised with the tangent at the end of a solve.

        The bounds do not move with the displacement, so that :meth:`respond` is the response of
        Tresca's problem.  Empty where nothing touches.  Collective.
        """
        bounds = [bound for bound in self._families.bounds if bound.friction.takes_part]
        if self.is_elastic or not bounds:
            return []
        for family, pair in zip(self._families.every, self._last().cones, strict=True):
            if pair is not None:
                family.x, family.z = family.centred(*pair)
        for bound in bounds:
            bound.friction.growth = np.zeros(len(bound.friction.weights))
        self._iterate.linearise()
        return [BoundLaw(bound, 1.0) for bound in bounds]

    def respond(self, reactions: Sequence[Reaction]) -> FloatArray:
        """The displacement that answers reactions, by the tangent linearised last; collective.

        Raises NotConverged where rounding makes that tangent singular.
        """
        with linear_failures():
            return self._tangent.respond(reactions, self._task.settings.tolerance)

    def state_of(self, saved: SavedState | None) -> SavedState | None:
        """A saved state with cones, of its multipliers if need be; None without; collective."""
        if saved is None or saved.cones:
            return saved
        if saved.multipliers is None:
            return None
        families, system = self._families, self._task.system
        with system.preserved():
            system.u.x.array[:] = saved.displacement
            for family in families.every:
                family.z = family.read(saved.multipliers)
            for bound in families.bounds:
                bound.friction.z[0] = bound.friction.nodes.of_all(bound.evaluate())
        # Where nodes have slid is not saved.
        pairs = tuple((np.zeros_like(family.x), family.z) for family in families.every)
        return replace(saved, cones=pairs)

    def _last(self) -> SavedState:
        if self._pieces is not None:
            return self._pieces.last()
        system, penalty = self._task.system, self._task.target.penalty
        taking_part = () if self.is_elastic else self._iterate.families
        cones = tuple(
            (family.x, family.z) if family in taking_part else None
            for family in self._families.every
        )
        return SavedState(system.u.x.array.copy(), system.tools.travels, penalty, cones)

    def require_feasible(self) -> None:
        """Raise Infeasible if the multipliers prove that nothing is admissible; collective."""
        factor = excluded_factor(self._iterate, self._task.target)
        if factor is not None:
            raise Infeasible(
                "infeasible: no displacement of this mesh within the locking limit and the gap "
                "follows the prescribed values; " + self._iterate.describe_excess(),
                factor,
            )

    def destroy(self) -> None:
        self._tangent.destroy()
        self._families.destroy()

    def _iterate_to_the_end(self, last: SavedState | None, by_pieces_alone: bool) -> float:
        """Iterate to the tolerances; the duality gap."""
        task, settings = self._task, self._task.settings
        self._judge.friction_change, self._first = 0.0, None
        self._left = self._stiffest = math.inf
        self._crawled, self._gap = 0, 0.0
        self._pieces, self._is_from_saved, self.is_elastic = None, False, False
        try:
            with linear_failures():
                is_found = self._start(last, by_pieces_alone)
        finally:
            task.counts.linear += self._tangent.pop_iterations()
        if self.is_elastic:
            unbalanced = self._tangent.residual_norms([])[0]
            task.monitor.iteration(0, unbalanced / (self._tangent.force_scale or 1.0))
        if self.is_elastic or is_found:
            return self._gap
        limit, tuning, target = settings.max_iterations, self._tuning, task.target
        # Where linear solves are direct, the pieces of the laws give locking stresses their law.
        has_digits = target.penalty.n <= tuning.stiffest_law * target.stiffness
        has_law = has_digits and bool(self._families.strains) and self._tangent.direct is None
        steps_left = tuning.steps_for_law if has_law else 0
        best, stays, is_soft = math.inf, 0, target.penalty.is_soft
        patience = tuning.patience_with_penalties if is_soft else tuning.patience
        can_rest = self.bound_moves and not task.system.tools.act
        for iteration in range(limit + 1):
            measures = self._judge.measure(self._iterate)
            task.monitor.iteration(iteration, measures.worst())
            if not np.isfinite(measures.equilibrium + measures.gap):
                raise NotConverged("the interior point iteration lost its digits")
            if can_rest and rests(task, self._tangent):
                self.is_elastic, self._judge.friction_change = True, 0.0
                task.system.remove_friction()
                return 0.0
            reached = measures.reached(settings, tuning.gap_tolerance)
            is_last = steps_left == 0 or iteration == limit
            if reached and (is_last or self._judge.keeps_penalty_law(self._iterate)):
                break
            if reached:
                steps_left -= 1
                self._search.aim_at_law()
            self._stop_if_infeasible(measures)
            if measures.worst() <= tuning.nearer * best:
                best, stays = measures.worst(), 0
            # Steps along which the forces of the body are not linear are shorter.
            stays += self._tangent.is_linear
            if stays > patience:
                if not is_soft:
                    self.require_feasible()
                raise NotConverged(
                    f"{patience} interior point iterations led no nearer ({measures})"
                )
            unbalanced = max(settings.tolerance, tuning.rounded * self._left)
            if self._tangent.direct is not None and measures.equilibrium > unbalanced:
                self._bound_stiffness()
            if iteration == limit:
                self.require_feasible()
                raise NotConverged(
                    f"{limit} interior point iterations did not suffice ({measures})"
                )
            try:
                leads_on = self._step(measures)
            except NotConverged:
                if not reached:
                    raise
                leads_on = False
            if leads_on:
                continue
            if reached:
                break
            self.require_feasible()
            raise NotConverged(f"the interior point step vanished ({measures})")
        return measures.gap

    # 1. The start.

    def _start(self, last: SavedState | None, by_pieces_alone: bool) -> bool:
        """Start around the elastic displacement; True if the pieces of the laws solve before."""
        task, target, tuning = self._task, self._task.target, self._tuning
        tangent, bounds = self._tangent, self._families.bounds
        pieces = self._pieces_of_laws(last is not None, by_pieces_alone)
        if pieces is not None and last is not None and pieces.knows(last):
            self._is_from_saved = self._take(pieces, pieces.from_last(last))
            if self._is_from_saved:
                return True
        if by_pieces_alone:
            raise NotConverged("the pieces of the laws are too far away")
        if last is not None:
            pieces = None
        elastic = ElasticStart(task, tangent, tuning)
        task.counts.tangents += 1
        is_admissible = elastic.solve()
        # A bound that stands still holds what it holds without any pressure, too.
        self.is_elastic = is_admissible and (
            self.bound_moves or all(bound.is_zero() for bound in bounds)
        )
        self._judge.begin(elastic.strain)
        if self.is_elastic:
            task.system.remove_friction()
            return False
        if pieces is not None and self._take(pieces, pieces.from_elastic()):
            return True
        opening = tuning.opening(self._approach, elastic.overstrain())
        least = opening * elastic.retreat() * target.length
        level = elastic.level()
        for family in tangent.families:
            family.start(level, least)
        for bound in bounds:
            bound.start(self.bound_moves, least)
            if not (bound.friction.takes_part or task.system.held_by_friction):
                # The springs of the elastic start hold a body that nothing else holds.
                bound.friction.hold(0.0)
        self._iterate = Iterate(tangent, tuning.band)
        self._iterate.soften(0.0)
        self._moving = [bound for bound in bounds if self.bound_moves and bound.friction.takes_part]
        settings, foresees = task.settings, self._approach.trusts_newton
        self._search = Search(self._iterate, self._moving, tuning, settings, foresees)
        return False

    def _pieces_of_laws(self, goes_on: bool, must: bool) -> ActiveSet | None:
        """The method that is tried before; None where it is no use.

        Where bounds follow the slip as well, it takes more tangents.  Bounds that do not move must
        be positive, and it must go on from a solution.
        """
        bounds = self._families.bounds
        if self.bound_moves:
            laws = [bound.law for bound in bounds]
            suits = all(law.is_coulomb and not law.depends_on_slip for law in laws)
        else:
            suits = goes_on and not any([bound.is_zero() for bound in bounds])
        suits = suits and bool(self._families.every) and self._approach == CLOSE
        if self._tangent.direct is None or not (suits or must):
            return None
        return self._all_pieces()

    def _all_pieces(self) -> ActiveSet:
        bounds = self._families.bounds
        return ActiveSet(
            self._task, self._tangent, bounds, self.bound_moves, self._judge, self._tuning
        )

    def _take(self, pieces: ActiveSet, found: Iterate | None) -> bool:
        if found is None:
            return False
        self._pieces, self._iterate, self._gap = pieces, found, pieces.gap
        return True

    # 2. The stopping rule.

    def _stop_if_infeasible(self, measures: Measures) -> None:
        """Raise Infeasible if multipliers that grow, while laws stay violated, prove it."""
        penalty, tuning = self._task.target.penalty, self._tuning
        if penalty.is_soft:
            return
        size = self._iterate.largest_multiplier()
        if self._first is None:
            self._first = size, measures.primal
        first_size, first_primal = self._first
        has_grown = size > tuning.diverged * first_size
        if has_grown and measures.primal > tuning.violated * first_primal:
            self._first = size, first_primal
            self.require_feasible()

    def _bound_stiffness(self) -> None:
        """Bound the stiffness of the steps that follow, by less than it was bounded before.

        Rounding in a displacement makes forces in proportion to that stiffness.
        """
        least, most = self._tuning.stiffest
        self._stiffest = min(max(0.1 * self._stiffest, least), most)
        self._iterate.soften(1.0 / (self._stiffest * self._task.target.stiffness))

    # 3 to 9. One iteration.

    def _step(self, measures: Measures) -> bool:
        """Take a step; False if there is none that leads anywhere; collective."""
        counts, iterate = self._task.counts, self._iterate
        try:
            for bound in self._moving:
                bound.friction.growth = np.maximum(bound.slope(), 0.0)
            with linear_failures():
                direction, t = self._searched(measures)
                t = self._tangent.trusted(t, direction.displacement)
        finally:
            counts.linear += self._tangent.pop_iterations()
        # An approach whose friction bounds lead nowhere crawls; another may not.
        self._crawled = self._crawled + 1 if self._moving and t < self._tuning.short else 0
        if not t > self._tuning.shortest or self._crawled > self._tuning.short_steps:
            return False
        iterate.advance(t, direction)
        # A step that leaves the friction bounds where it brought them leaves so much unbalanced.
        self._left = (1.0 - t) * measures.equilibrium if self._tangent.is_linear else math.inf
        if self._moving:
            self._follow(t)
            counts.updates += 1
        return True

    def _searched(self, measures: Measures) -> tuple[Direction, float]:
        """A direction and its length; of softer steps where rounding makes a tangent singular."""
        while True:
            try:
                self._iterate.linearise()
                self._task.counts.tangents += 1
                return self._search.step(measures)
            except PETSc.Error as error:
                raise_callback_error(error)
                least = self._tuning.stiffest[0]
                if self._tangent.direct is None or self._stiffest <= least:
                    raise
                self._bound_stiffness()

    def _follow(self, t: float) -> None:
        """Note how far a step of length t left the friction bounds from ``mu |R p|``; collective.

        Where it came hardly closer the bounds are set to that: the linearisation fails where slips
        stop, start or turn round.
        """
        tuning, moving = self._tuning, self._moving
        before = self._judge.friction_change
        wanted, used = self._judge.compare(moving)
        close_enough = tuning.bound_closer * before
        if t >= tuning.bound_led:
            close_enough = max(close_enough, tuning.bound_close)
        came_closer = self._judge.friction_change <= close_enough
        self._task.system.bounds.set([item.contact for item in moving], used)
        if not (came_closer and self._approach.trusts_newton):
            self._left = math.inf
            for item, values in zip(moving, wanted, strict=True):
                item.set(values)
                item.friction.set_bound(item.friction.nodes.of_all(values))
