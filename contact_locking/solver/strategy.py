"""The entry point of the general solver: its attempts in their order, and why all of them failed.

After a failure it looks for the reason: a proof that there is no solution, or forces that grow with
the penalty.  Each is computed on first use.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from contact_locking.errors import Infeasible, NotConverged
from contact_locking.laws.limits import Penalty
from contact_locking.parallel import maximum
from contact_locking.problem.system import System, SystemState
from contact_locking.solver.interior_point.judge import GAP_ROUNDING
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.interior_point.tuning import CLOSE, WIDE, Approach
from contact_locking.solver.task import Counts, Outcome, SavedState, Target, Task, stage_of

_MORE_ITERATIONS = "Raise solver.max_iterations if it was low."
BOUND_ADVICE = (
    "If the friction bound does not settle, lower the loads or friction.coefficient, or enlarge "
    "friction.smoothing.radius."
)
# Less friction is no help for a body that friction holds.
_HELD_BY_FRICTION = (
    "Friction alone holds the body: if the loads need all of the friction there is, lower them, "
    "press the body more, raise friction.coefficient, or hold the body by loads.displacements.  If "
    "the friction bound does not settle, enlarge friction.smoothing.radius."
)
_VERGE_ADVICE = (
    "If the strain limit only just admits the prescribed displacements and the gap, as round "
    "numbers may be chosen, change one of them by 0.1 %: then there is a solution, or a proof that "
    "there is none."
)
_WEDGED_ADVICE = (
    "Lower friction.coefficient.  Where friction wedges the body in, the pressure may grow without "
    "a bound, and there may be no equilibrium."
)


class Reasons:
    """Why a task may have no solution; all members are collective."""

    def __init__(self, task: Task) -> None:
        self._task = task

    @functools.cached_property
    def is_unbalanced(self) -> bool:
        """Whether it is proved that no forces of contact and friction balance the loads."""
        return self._task.is_unbalanced()

    @functools.cached_property
    def _without_friction(self) -> tuple[Verdict | None, float | None]:
        return _judged(self._task)

    @property
    def verdict(self) -> Verdict | None:
        """The proof that no displacement is admissible, or None."""
        return self._without_friction[0]

    @functools.cached_property
    def growth(self) -> Growth | None:
        """Two solutions whose forces grow with the penalty, None if there are none."""
        is_strict = self._task.target.penalty.is_strict
        return find_growth(self._task, self._without_friction[1] if is_strict else None)

    def may_have_solution(self, failed: Outcome) -> bool:
        """Whether there may be a solution after a failed attempt."""
        task = self._task
        if failed.failure == Infeasible.code or self.is_unbalanced or not task.searches:
            return False
        # Penalised problems have solutions where nothing is admissible.
        if task.target.penalty.is_strict and self.verdict is not None:
            return False
        return self.growth is None

    def explain(self, failed: Outcome) -> Outcome:
        """The failure with its reason and a suggestion.

        If forces grow, the system gets the solution for the stiffer of the two penalties.
        """
        task, failed = self._task, dataclasses.replace(failed, suggestion=_advice(self._task))
        if self.is_unbalanced:
            return dataclasses.replace(failed, failure="solver.unheld")
        if task.searches and failed.failure != Infeasible.code and self.growth is not None:
            task.system.restore(self.growth.stiffer.state)
            return dataclasses.replace(
                self.growth.stiffer.outcome,
                converged=False,
                failure="solver.forces_grow",
                reason=f"{failed.reason}; {self.growth.reason}",
                suggestion=_WEDGED_ADVICE,
            )
        if (verdict := self.verdict) is not None:
            is_strict = task.target.penalty.is_strict
            code = Infeasible.code if is_strict else "solver.infeasible_limit"
            return dataclasses.replace(
                failed,
                failure=code,
                reason=verdict.reason,
                suggestion=verdict.advice,
                admissible_factor=verdict.factor,
            )
        return failed


def _advice(task: Task) -> str:
    """Advice after a failure without a known reason; collective."""
    system, advice = task.system, [_MORE_ITERATIONS]
    if system.rubbing:
        advice.append(_HELD_BY_FRICTION if system.held_by_friction else BOUND_ADVICE)
    inverse_limits = [strains.inverse_limit.x.array for strains in system.data.sets]
    if maximum(system.comm, np.concatenate(inverse_limits)) > 0.0:
        advice.append(_VERGE_ADVICE)
    return "  ".join(advice)


# Whether anything is admissible.

# The relative distance of the bounds of the admissible factor.
_PRECISION = 0.01
# The penalty, over the stiffness, whose multipliers are tried for a proof.
_STIFF = 1e6
_ROUNDS = 8


@dataclasses.dataclass(frozen=True)
class Verdict:
    """It is proved that no admissible field on this mesh has the prescribed values u_D.

    - ``place``: what is exceeded and where, in words
    - ``factor``: bounds of the largest s for which s u_D is possible: the first is (0 if unknown),
      the second is not; None if scaling u_D does not help
    """

    place: str
    factor: tuple[float, float] | None
    advice: ClassVar[str] = (
        "Refine the mesh, lower the prescribed displacements, raise material.locking_limit (or the "
        "limits of material.locking), or move the foundation away; a soft penalty.n has a solution "
        "that exceeds the limit."
    )

    @property
    def reason(self) -> str:
        """Why there is no solution, and which share of u_D is possible."""
        if self.factor is None:
            return self.place
        low, high = (f"{100.0 * share:.3g}" for share in self.factor)
        share = f"{low} to {high}" if self.factor[0] else f"less than {high}"
        return f"{self.place}; {share} % of the prescribed displacements are possible on this mesh"


def _judged(task: Task) -> tuple[Verdict | None, float | None]:
    """The verdict, or the contact force without friction if that problem was solved.

    Friction and penalties do not matter here, so the problem is solved without them, unless
    friction alone holds the body.  The system is restored, and the cost is counted.
    """
    system = task.system
    prescribed = system.constraints.held_part(system.u.x.array)
    rounding = GAP_ROUNDING * task.target.length
    overlaps = any(bool(np.any(contact.gaps < -rounding)) for contact in system.contacts)
    zero_is_admissible = not system.comm.allreduce(bool(prescribed.any()) or overlaps)
    if system.held_by_friction or zero_is_admissible:
        return None, None
    with task.system.preserved():
        counts = Counts()
        limit = dataclasses.replace(task.target, penalty=task.target.penalty.inequality())
        exact, penalised = (
            InteriorPoint(task.aside(counts, target), bound_moves=False)
            for target in (limit, _stiff(limit))
        )

        force: float | None = None

        def fails(factor: float) -> Infeasible | None:
            nonlocal force
            system.constraints.share = factor
            system.u.x.array[:] = factor * prescribed
            try:
                force = _force(system, exact.solve())
                return None
            except Infeasible as failure:
                return failure
            except NotConverged as failure:
                unsolved = failure
            system.u.x.array[:] = factor * prescribed
            try:
                penalised.solve()
                penalised.require_feasible()
            except Infeasible as failure:
                return failure
            raise unsolved

        try:
            system.remove_friction()
            failure = fails(1.0)
            if failure is None:
                return None, force
            scales = 0.0 < failure.factor < math.inf
            factor = _bracket(fails, failure.factor) if scales else None
            return Verdict(str(failure), factor), None
        except NotConverged:
            return None, None
        finally:
            system.constraints.share = 1.0
            task.counts.add(counts)
            exact.destroy()
            penalised.destroy()


def _stiff(target: Target) -> Target:
    """The target with a stiff penalty, whose multipliers balance even if nothing is admissible."""
    n = _STIFF * target.stiffness
    penalty = Penalty(n, target.length / n, target.penalty.regularisations)
    return dataclasses.replace(target, penalty=penalty)


def _bracket(fails: Callable[[float], Infeasible | None], excluded: float) -> tuple[float, float]:
    """Bounds of the admissible factor: a trial just below ``excluded`` works or excludes more."""
    for _ in range(_ROUNDS):
        trial = (1.0 - 0.5 * _PRECISION) * excluded
        try:
            failure = fails(trial)
        except NotConverged:
            break
        if failure is None:
            return trial, excluded
        excluded = trial * min(1.0, failure.factor)
    return 0.0, excluded


# Whether forces grow with the penalty.

# Two penalties, as powers of ten over the stiffness of the material, and the least exponent with
# which forces grow between them if friction wedges the body in; forces that have a limit hardly
# grow.  The second row is for problems whose stiffer penalty of the first has no solution.
_PENALTIES = ((3.0, 4.0, 0.4), (2.5, 3.5, 0.7))
# Growing forces exceed those without friction, which loads and prescribed displacements cause, by
# the first factor; the second is the share of the friction coefficient that stands for none.
_LARGE, _LITTLE = 3.0, 1e-3


@dataclasses.dataclass(frozen=True)
class PenalisedState:
    """The solution for penalties of ``10**power`` times the stiffness.

    ``force`` is the sum of its pressures.
    """

    power: float
    penalty: Penalty
    outcome: Outcome
    force: float
    state: SystemState


@dataclasses.dataclass(frozen=True)
class Growth:
    """Solutions for two penalties whose forces grow with them: friction wedges the body in.

    For a finite penalty the friction bounds of all solutions are bounded.  As the penalty grows,
    forces either converge or grow with it.  Growing forces balance each other whatever the loads
    are, and only the penalty limits them.
    """

    softer: PenalisedState
    stiffer: PenalisedState

    @property
    def reason(self) -> str:
        """The message that there seems to be no equilibrium."""
        penalty, ratio = self.stiffer.penalty, self.stiffer.force / self.softer.force
        return (
            f"with penalties of {10.0**self.softer.power:.2g} and {10.0**self.stiffer.power:.2g} "
            "times the stiffness of the material there are solutions, and the stiffer one has "
            f"{ratio:.2g} times the contact force of the other: forces grow with the penalty, and "
            "without one there seems to be no equilibrium; the result is the solution for "
            f"penalty.n: {penalty.n:g}, penalty.epsilon: {penalty.epsilon:g} and "
            f"friction.regularisation: {max(penalty.regularisations):g}"
        )


def find_growth(task: Task, without: float | None = None) -> Growth | None:
    """Two penalties whose forces grow, None without growth or solutions; collective.

    ``without`` is the contact force without friction, if known.  The system is restored, and the
    cost is counted.
    """
    system = task.system
    if task.target.penalty.epsilon > 0.0 or system.held_by_friction or not system.rubbing:
        return None
    task.monitor.message("solving with softer penalties to see whether forces grow with them")
    states: dict[float, PenalisedState | None] = {}
    for soft, stiff, least in _PENALTIES:
        start: SavedState | None = None
        for power in (soft, stiff):
            if power not in states:
                states[power] = _penalised(task, _softened(task.target, power), power, start)
            # From the solution for a softer penalty the pieces of the laws take few tangents.
            state = states[power]
            start = None if state is None else state.outcome.last
        softer, stiffer = states[soft], states[stiff]
        if softer is None or stiffer is None:
            continue
        if not stiffer.force > 10.0 ** (least * (stiff - soft)) * softer.force > 0.0:
            return None
        if without is None:
            state = _penalised(task, task.target, math.inf, share=_LITTLE)
            without = math.inf if state is None else state.force
        return Growth(softer, stiffer) if stiffer.force > _LARGE * without else None
    return None


def _penalised(
    task: Task, target: Target, power: float, start: SavedState | None = None, share: float = 1.0
) -> PenalisedState | None:
    """The solution for a target and a share of friction, None if it fails; collective."""
    system, counts = task.system, Counts()
    solver = InteriorPoint(task.aside(counts, target), share=share)
    try:
        with system.preserved():
            system.u.x.array[:] = system.constraints.held_part(system.u.x.array)
            outcome = solver.solve(start)
            force = _force(system, outcome)
            return PenalisedState(power, target.penalty, outcome, force, system.state())
    except NotConverged:
        return None
    finally:
        solver.destroy()
        task.counts.add(counts)


def _force(system: System, outcome: Outcome) -> float:
    """The sum of the pressures of a solution; collective."""
    assert outcome.multipliers is not None
    pairs = zip(system.contacts, outcome.multipliers.contacts, strict=True)
    return sum(float(contact.surface.integral(forces.pressure)) for contact, forces in pairs)


def _softened(target: Target, power: float) -> Target:
    """The target with penalties of at most ``10**power`` times the stiffness.

    Friction is regularised as by default for this penalty.  The numbers have three digits, which
    a message can print.
    """
    penalty = target.penalty
    n = min(penalty.n, _rounded(10.0**power * target.stiffness))
    epsilon = max(penalty.epsilon, _rounded(target.length / (10.0**power * target.stiffness)))
    least = _rounded(epsilon * target.young)
    lengths = tuple(max(length, least) for length in penalty.regularisations)
    return dataclasses.replace(target, penalty=Penalty(n, epsilon, lengths))


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


# Each attempt starts at the elastic displacement and is finished by the pieces of the laws.  The
# first also tries the pieces before the interior point method, from a saved state and from that
# displacement.  docs/notes/ladder.md counts the random problems that each attempt solves.
LADDER = (CLOSE, WIDE)


def solve(task: Task, saved: SavedState | None = None) -> Outcome:
    """Solve the system of ``task`` for the penalty of its target; collective.

    The solve tries the state ``saved`` first; the outcome's ``from_saved`` says whether that led to
    the solution.
    """
    penalty, reasons = task.target.penalty, Reasons(task)
    task.monitor.stage(1, 1, penalty.n, penalty.epsilon)
    # Without friction all attempts would be the same.
    first, *others = LADDER if task.system.rubbing else LADDER[:1]
    outcome = _attempt(first, task, saved)
    for approach in others:
        if not outcome.converged and reasons.may_have_solution(outcome):
            outcome = _attempt(approach, task, None)
    if not outcome.converged:
        outcome = reasons.explain(outcome)
    outcome = outcome.with_counts(task.counts, [stage_of(penalty, task.counts.tangents)])
    task.system.tools.update_unloaded(task.system.u)
    task.monitor.counted(outcome.tangents, outcome.updates)
    return outcome


def _attempt(approach: Approach, task: Task, saved: SavedState | None) -> Outcome:
    """The outcome of one attempt, finished by the pieces of the laws; collective.

    The solver is destroyed before the next attempt, because it takes much memory.
    """
    system, solver = task.system, InteriorPoint(task, approach)
    system.u.x.array[:] = system.constraints.held_part(system.u.x.array)
    try:
        return solver.finish(solver.solve(solver.state_of(saved)))
    except NotConverged as failure:
        return (None if isinstance(failure, Infeasible) else solver.rescue()) or Outcome(
            solver.multipliers(),
            friction_change=solver.friction_change,
            failure=failure.code,
            reason=str(failure),
        )
    finally:
        solver.destroy()
