"""A primal-dual interior point method for the contact problem, for any n up to infinity.

For known friction bounds the problem is a second-order cone programme with many small cones: one
for each point of a cell and two for each node of Gamma_C.  Each cone is eliminated locally, which
leaves an elasticity system for the displacement.  The friction bounds are unknowns of the same
Newton step (:mod:`bound_step`), so that the non-local problem takes only a few back-substitutions
more than one with known bounds.

1. Start: compute the elastic displacement (:mod:`start`).  If it is admissible and no contact has
   friction forces, it is the solution.  Otherwise each family starts near its central path.
2. Measure equilibrium, laws, duality gap and friction bound (:mod:`judge`).  Stop at the
   tolerances, or with a proof that nothing is admissible (:mod:`judge`).  A penalised solution
   that the pieces of the laws will not finish goes on until each locking stress keeps its law.
3. Linearise: scale each cone by Nesterov and Todd (doi:10.1287/moor.22.1.1), eliminate it, and
   assemble and factorise the tangent.  Everything up to 8 uses that factorisation.
4. Predictor: the direction towards products of zero; it predicts the step of the friction bound.
5. Corrector: the direction towards a target for the products, which the predictor determines, with
   second-order terms (Mehrotra, doi:10.1137/0802028).
6. Friction bound: solve for the step of the bound and the direction that agree.
7. Recentring: while the step is short, correct the products that would leave their band (Gondzio,
   doi:10.1007/BF00249643); then repeat 6 if direction and bound no longer agree.
8. Step towards the boundary of the cones; a step that may be the last also balances the forces.
9. If the step hardly brought the bound closer to ``mu |R p|``, set it to that.  Go on with 2.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import Infeasible, NotConverged
from contact_locking.solver.interior_point.active_set import FAILURE, ActiveSet
from contact_locking.solver.interior_point.bound_step import BoundLaw
from contact_locking.solver.interior_point.family import Reactions
from contact_locking.solver.interior_point.iterate import Iterate, families_of
from contact_locking.solver.interior_point.judge import Judge, Measures, excluded_factor
from contact_locking.solver.interior_point.search import Search
from contact_locking.solver.interior_point.start import ElasticStart, rests
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.interior_point.tuning import CLOSE, Approach, Tuning
from contact_locking.solver.ksp import linear_failures
from contact_locking.solver.task import Multipliers, Outcome, SavedState, Task


class InteriorPoint:
    """The method for one task; methods are collective.

    It starts cold: a previous solution lies on the boundary of its cones and is no better start.

    - ``bound_moves``: whether friction bounds follow the pressure; if not they stay in force
    - ``share``: the share of the friction coefficient that acts
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
        self._iterate = Iterate(self._tangent)
        self._judge = Judge(task, self._tangent, tuning)
        #: Whether the elastic displacement alone is the solution.
        self.is_elastic = False
        self._pieces: ActiveSet | None = None
        self._first: tuple[float, float] | None = None
        self._is_from_saved = False

    def solve(self, last: SavedState | None = None, by_pieces_alone: bool = False) -> Outcome:
        """Iterate to the tolerances; if that raises NotConverged the system has the last iterate.

        ``last`` is a solution that may be near, such as that of the previous step.
        """
        # The checks of steps and residuals detect NaN.
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

    def finish(self, outcome: Outcome) -> Outcome:
        """The outcome improved to its last digits by the pieces of the laws.

        Locking stresses, smoothed friction and penalised solutions need it.  The outcome stays as
        it is with an iterative linear solver, and if the pieces do not converge.
        """
        if self._pieces is not None or outcome.last is None:
            return outcome
        penalty = self._task.target.penalty
        is_rough = bool(self._families.strains) or self._judge.leaves_gap
        if penalty.is_strict and not is_rough and not any(penalty.regularisations):
            return outcome
        return self._by_pieces(outcome.last) or outcome

    def rescue(self) -> Outcome | None:
        """The solution by the pieces of the laws from the last iterate, None if they fail."""
        return self._by_pieces(self._last()) if self._iterate.is_finite else None

    def _by_pieces(self, last: SavedState) -> Outcome | None:
        """The solution by the pieces of the laws from a saved state, None if they fail.

        They need a direct linear solver, and an elastic solution has nothing to improve.
        """
        if self.is_elastic or self._tangent.direct is None:
            return None
        pieces = self._all_pieces()
        with np.errstate(all="ignore"):
            if not self._accept(pieces, pieces.from_last(last)):
                return None
        return self._solved(self._gap)

    def multipliers(self) -> Multipliers:
        """The multipliers of the present iterate."""
        system = self._task.system
        multipliers = Multipliers.zero(system)
        if not self.is_elastic:
            for family in self._iterate.families:
                family.write(multipliers, self._task.target.young)
            multipliers.add_up(system.data)
        return multipliers

    def linearised_bounds(self) -> list[BoundLaw]:
        """The laws of all friction bounds, linearised at the solution together with the tangent.

        The tangent is that of known bounds, so that :meth:`respond` is the response of Tresca's
        problem.  Empty if nothing touches.
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

    def respond(self, reactions: Reactions) -> FloatArray:
        """The displacement that reactions cause, by the last tangent.

        Raises NotConverged if rounding makes that tangent singular.
        """
        with linear_failures():
            return self._tangent.respond(reactions, self._task.settings.tolerance)

    def state_of(self, saved: SavedState | None) -> SavedState | None:
        """``saved`` with its cones, computed from its multipliers if need be; None without both."""
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
        # Multipliers do not say which nodes have slid.
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
        """Raise Infeasible if the multipliers prove that nothing is admissible."""
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
        """Iterate to the tolerances, and return the duality gap."""
        task, settings = self._task, self._task.settings
        self._judge.friction_change, self._first = 0.0, None
        self._crawled, self._gap = 0, 0.0
        self._pieces, self._is_from_saved, self.is_elastic = None, False, False
        with linear_failures():
            is_solved = self._start(last, by_pieces_alone)
        if self.is_elastic:
            unbalanced = self._tangent.residual_norms({})[0]
            task.monitor.iteration(0, unbalanced / (self._tangent.force_scale or 1.0))
        if self.is_elastic or is_solved:
            return self._gap
        limit, tuning, target = settings.max_iterations, self._tuning, task.target
        # With a direct linear solver the pieces of the laws give locking stresses their law.
        has_digits = target.penalty.n <= tuning.stiffest_law * target.stiffness
        aims_at_law = has_digits and bool(self._families.strains) and self._tangent.direct is None
        steps_for_law = tuning.steps_for_law if aims_at_law else 0
        best, stays, is_soft = math.inf, 0, target.penalty.is_soft
        patience = tuning.patience_with_penalties if is_soft else tuning.patience
        may_rest = self.bound_moves and not task.system.tools.act
        for iteration in range(limit + 1):
            measures = self._judge.measure(self._iterate)
            task.monitor.iteration(iteration, measures.worst())
            if not np.isfinite(measures.equilibrium + measures.gap):
                raise NotConverged("the residual of the interior point iteration is not finite")
            if may_rest and rests(task, self._tangent):
                self.is_elastic, self._judge.friction_change = True, 0.0
                task.system.remove_friction()
                return 0.0
            reached = measures.reached(settings, tuning.gap_tolerance)
            is_last = steps_for_law == 0 or iteration == limit
            if reached and (is_last or self._judge.keeps_penalty_law(self._iterate)):
                break
            if reached:
                steps_for_law -= 1
                # A gap that is small enough for the penalty law at each point.
                self._search.gap_aim = tuning.gap_aim_of_law
            self._stop_if_infeasible(measures)
            if measures.worst() <= tuning.nearer * best:
                best, stays = measures.worst(), 0
            # An energy of the user's may shorten steps, so that they do not count here.
            stays += self._tangent.is_linear
            if stays > patience:
                if not is_soft:
                    self.require_feasible()
                raise NotConverged(
                    f"{patience} interior point iterations made no progress ({measures})"
                )
            if iteration == limit:
                self.require_feasible()
                raise NotConverged(
                    f"{limit} interior point iterations did not suffice ({measures})"
                )
            try:
                has_moved = self._step(measures)
            except NotConverged:
                if not reached:
                    raise
                has_moved = False
            if has_moved:
                continue
            if reached:
                break
            self.require_feasible()
            raise NotConverged(f"the interior point step vanished ({measures})")
        return measures.gap

    # 1. The start.

    def _start(self, last: SavedState | None, by_pieces_alone: bool) -> bool:
        """Start near the elastic displacement; True if the pieces of the laws already solve."""
        task, target, tuning = self._task, self._task.target, self._tuning
        tangent, bounds = self._tangent, self._families.bounds
        pieces = self._pieces_of_laws(last is not None, by_pieces_alone)
        if pieces is not None and last is not None:
            self._is_from_saved = self._accept(pieces, pieces.from_last(last))
            if self._is_from_saved:
                return True
        if by_pieces_alone:
            raise NotConverged(FAILURE)
        if last is not None:
            pieces = None
        elastic = ElasticStart(task, tangent, tuning)
        task.counts.tangents += 1
        is_admissible = elastic.solve()
        # A fixed friction bound acts even without any pressure.
        self.is_elastic = is_admissible and (
            self.bound_moves or all(bound.is_zero() for bound in bounds)
        )
        self._judge.begin(elastic.strain)
        if self.is_elastic:
            task.system.remove_friction()
            return False
        if pieces is not None and self._accept(pieces, pieces.from_elastic()):
            return True
        opening = tuning.opening(self._approach, elastic.overstrain())
        least = opening * elastic.retreat() * target.length
        level = elastic.level()
        for family in tangent.families:
            family.start(level, least)
        for bound in bounds:
            bound.start(self.bound_moves, least)
            if not (bound.friction.takes_part or task.system.held_by_friction):
                # Remove the springs of the elastic start, unless only they hold the body.
                bound.friction.hold(0.0)
        self._iterate = Iterate(tangent)
        self._moving = [bound for bound in bounds if self.bound_moves and bound.friction.takes_part]
        settings, predicts = task.settings, self._approach.trusts_newton
        self._search = Search(self._iterate, self._moving, tuning, settings, predicts)
        return False

    def _pieces_of_laws(self, has_saved: bool, is_required: bool) -> ActiveSet | None:
        """Newton's method on the pieces of the laws, None where it would not help.

        A coefficient that depends on the slip makes it slower.  Fixed bounds must be positive, and
        then it also needs a saved solution.
        """
        bounds = self._families.bounds
        if self.bound_moves:
            laws = [bound.law for bound in bounds]
            suits = all(law.is_coulomb and not law.depends_on_slip for law in laws)
        else:
            suits = has_saved and not any([bound.is_zero() for bound in bounds])
        suits = suits and bool(self._families.every) and self._approach == CLOSE
        if self._tangent.direct is None or not (suits or is_required):
            return None
        return self._all_pieces()

    def _all_pieces(self) -> ActiveSet:
        bounds = self._families.bounds
        return ActiveSet(
            self._task, self._tangent, bounds, self.bound_moves, self._judge, self._tuning
        )

    def _accept(self, pieces: ActiveSet, iterate: Iterate | None) -> bool:
        if iterate is None:
            return False
        self._pieces, self._iterate, self._gap = pieces, iterate, pieces.gap
        return True

    # 2. The stopping rule.

    def _stop_if_infeasible(self, measures: Measures) -> None:
        """Raise Infeasible with a proof, tried if multipliers grow and laws stay violated."""
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

    # 3 to 9. One iteration.

    def _step(self, measures: Measures) -> bool:
        """Take a step; False if the step is too short to help."""
        for bound in self._moving:
            bound.friction.growth = np.maximum(bound.slope(), 0.0)
        with linear_failures():
            self._iterate.linearise()
            self._task.counts.tangents += 1
            direction, t = self._search.step(measures)
            t = self._tangent.trusted(t, direction.displacement)
        # Many short steps with moving friction bounds end this approach; another one may succeed.
        self._crawled = self._crawled + 1 if self._moving and t < self._tuning.short else 0
        if not t > self._tuning.shortest or self._crawled > self._tuning.short_steps:
            return False
        self._iterate.advance(t, direction)
        if self._moving:
            self._follow(t)
            self._task.counts.updates += 1
        return True

    def _follow(self, t: float) -> None:
        """Measure how far the friction bounds are from ``mu |R p|`` after a step of length t.

        If the step hardly brought them closer they are set to that: the linearisation fails where
        slips start, stop or reverse.
        """
        tuning, moving = self._tuning, self._moving
        before = self._judge.friction_change
        by_law, used = self._judge.compare(moving)
        close_enough = tuning.bound_closer * before
        if t >= tuning.bound_led:
            close_enough = max(close_enough, tuning.bound_close)
        came_closer = self._judge.friction_change <= close_enough
        self._task.system.bounds.set([bound.contact for bound in moving], used)
        if not (came_closer and self._approach.trusts_newton):
            for bound, values in zip(moving, by_law, strict=True):
                bound.set(values)
                bound.friction.set_bound(bound.friction.nodes.of_all(values))
