"""Newton's last steps to a solution with its friction bound, from a state that may be near."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from petsc4py import PETSc

from contact_locking.errors import NotConverged
from contact_locking.solver.fixed_point import fixed_point
from contact_locking.solver.newton import NewtonSolver
from contact_locking.solver.task import Outcome, SavedState, Target, Task

# The last digits of the friction bound need an equilibrium that is sharper than the bound.
INNER_SHARE = 0.1
# The equilibrium needs to be this much sharper than the last change of the friction bound, and at
# the first bound this sharp.
_SHARE_OF_CHANGE, _FIRST = 1e-2, 1e-3
# Newton's convergence radius shrinks like n^-1/2: beyond these values of n/stiffness and
# length/epsilon an interior point solution is too far for it, and where a few steps do not
# arrive, many do not.
_POLISHED_UP_TO = 1e7
# A step of Newton's method enlarges the residual up to so many times as the penalties are stiffer
# than the body.  Where the product is above this (relative to the forces), a few steps hardly
# arrive.
_REACH = 1e3
# Of a state that no solver has found nothing is known.
NOTHING = Outcome()


def settle(
    newton: NewtonSolver, task: Task, found: Outcome = NOTHING, least_steps: int = 0
) -> Outcome:
    """Solve to the tolerances, with the friction bound's fixed point where there is friction.

    At least ``least_steps`` are taken; with friction each bound takes one, and its solve is only as
    sharp as the bound is known.  Returns what is known beside that of ``found``.
    """
    tolerance = task.settings.tolerance

    def solve(change: float) -> None:
        wanted = min(_SHARE_OF_CHANGE * change, _FIRST)
        newton.solve(max(INNER_SHARE * tolerance, wanted), least_steps=1)

    if task.system.rubbing:
        found = found.settled(*fixed_point(task, solve, task.system.penalty_bounds))
    newton.solve(tolerance, least_steps=0 if task.system.rubbing else least_steps)
    # The multipliers are those of the laws.
    return replace(found, multipliers=None)


def polish(
    task: Task,
    most_steps: int,
    found: Outcome = NOTHING,
    direct: PETSc.KSP | None = None,
    near: bool = True,
) -> Outcome | None:
    """Where Newton's method arrives from the present state; None if not, with that state restored.

    ``found`` is what is known of the present state.
    """
    if not has_digits(task.target):
        return None
    limit = min(most_steps, task.settings.max_iterations)
    task.system.set_penalty(task.target.penalty)
    few = task.with_settings(max_iterations=limit)
    newton = NewtonSolver(few, near, direct)
    try:
        with task.system.preserved(only_on_failure=True):
            # One step takes off most of what is left within the tolerances.
            return settle(newton, few, found, least_steps=1)
    except NotConverged:
        return None
    finally:
        newton.destroy()


def has_digits(target: Target) -> bool:
    """Whether the penalties leave the residual of (26) digits enough for Newton."""
    return _sharpness(target) <= _POLISHED_UP_TO


def is_in_reach(task: Task) -> bool:
    """Whether a few steps of Newton's method arrive from here, as can be foreseen; collective."""
    if not has_digits(task.target):
        return False
    task.system.set_penalty(task.target.penalty)
    residual = task.system.relative_residual(task.settings.tolerance)
    return residual * _sharpness(task.target) <= _REACH


def _sharpness(target: Target) -> float:
    """How much stiffer than the body the penalties are at most."""
    penalty = target.penalty
    shortest = min((penalty.epsilon * target.young, *penalty.regularisations))
    stiffest = target.length / shortest if shortest > 0.0 else math.inf
    return max(penalty.n / target.stiffness, stiffest)


# Newton's steps for one friction bound, and the updates of the bound.
_MOST_STEPS, _MOST_UPDATES = 12, 12
# Steps of 1 % of the load leave residuals (relative to the forces) of 150 at most after the first
# step and of 6 three steps later.  With many times more Newton's method hardly arrives.
_NEAR, _ARRIVES = 500.0, {3: 50.0}


def step_on(saved: SavedState, task: Task) -> Outcome | None:
    """Where Newton's method arrives from the step before, in a process with regularised friction.

    A point that sticks needs a slip of the order of delta in every step, and begins at slip
    zero, where the tangent of friction is ``G/delta``, far stiffer than on the way to the
    solution.  So the first step takes the secant ``G/sqrt(s^2 + delta^2)`` for the slip ``s``
    of the step before.  If Newton's method does not arrive, None, and displacement and friction
    bounds are of no use.
    """
    settings, system = task.settings, task.system
    few = task.with_settings(
        max_iterations=min(_MOST_STEPS, settings.max_iterations),
        max_friction_updates=min(_MOST_UPDATES, settings.max_friction_updates),
    )
    saved.enter(system)
    system.set_penalty(task.target.penalty)
    newton = NewtonSolver(few, near=True, arrives=_ARRIVES)
    try:
        _first_step(newton, saved, task)
        if system.relative_residual(settings.tolerance) > _NEAR:
            return None
        return settle(newton, few)
    except NotConverged:
        return None
    finally:
        newton.destroy()


def _first_step(newton: NewtonSolver, saved: SavedState, task: Task) -> None:
    """A Newton step from slip zero with the secant of friction; collective."""
    contacts, in_force = task.system.contacts, task.system.bounds
    bounds = in_force.at(contacts)
    for contact, bound, slip in zip(contacts, bounds, saved.slips, strict=True):
        # At slip zero this bound has the secant of the whole bound as its tangent.
        length = in_force.lengths[contact]
        in_force[contact] = bound * length / np.hypot(slip, length) if length > 0.0 else bound
    newton.step()
    in_force.enter(contacts, bounds)
