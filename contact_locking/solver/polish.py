"""Newton's last steps to a solution with its friction bound, from a state that may be near."""

from __future__ import annotations

import math

from petsc4py import PETSc

from contact_locking.errors import NotConverged
from contact_locking.solver.fixed_point import fixed_point
from contact_locking.solver.newton import NewtonSolver
from contact_locking.solver.target import Target
from contact_locking.solver.task import Task

# The last digits of the friction bound need an equilibrium that is sharper than the bound.
INNER_SHARE = 0.1
# Newton's convergence radius shrinks like n^-1/2: beyond these values of n/stiffness and
# length/epsilon an interior point solution is too far for it, and where a few steps do not
# arrive, many do not.
_POLISHED_UP_TO = 1e7
# A step of Newton's method enlarges the residual up to so many times as the penalties are stiffer
# than the body.  Where the product is above this (relative to the forces), a few steps hardly
# arrive.
_REACH = 1e3


def settle(newton: NewtonSolver, task: Task) -> None:
    """Solve to the tolerances, with the friction bound's fixed point where there is friction."""
    tolerance = task.settings.tolerance
    if task.system.rubbing:
        fixed_point(
            task,
            lambda: newton.solve(INNER_SHARE * tolerance, least_steps=1),
            task.system.penalty_bounds,
        )
    newton.solve(tolerance)


def polish(task: Task, most_steps: int, direct: PETSc.KSP | None = None, near: bool = True) -> bool:
    """Whether Newton's method arrives from the present state; if not, that state is restored."""
    if not has_digits(task.target):
        return False
    report = task.report
    change, contraction = report.friction_change, report.contraction
    limit = min(most_steps, task.settings.max_iterations)
    task.system.set_penalty(task.target.penalty)
    few = task.with_settings(max_iterations=limit)
    newton = NewtonSolver(few, near, direct)
    try:
        with task.system.preserved(only_on_failure=True):
            settle(newton, few)
    except NotConverged:
        report.friction_change, report.contraction = change, contraction
        return False
    finally:
        newton.destroy()
    report.multipliers = None
    return True


def has_digits(target: Target) -> bool:
    """Whether the penalties leave the residual of (26) digits enough for Newton."""
    return _sharpness(target) <= _POLISHED_UP_TO


def is_in_reach(task: Task) -> bool:
    """Whether a few steps of Newton's method arrive from here, as far as can be foreseen.

    Collective.
    """
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
