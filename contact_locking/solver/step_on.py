"""Newton's method from the step before, for a process with regularised friction.

A point that sticks needs a slip of the order of delta in every step, and at the start of a step the
slip is zero.  There the tangent of friction is ``G/delta``, far stiffer than on the way to the
solution.  So the first step takes the secant ``G/sqrt(s^2 + delta^2)`` for the slip ``s`` of the
step before, which is exact if the point slides on as before.
"""

from __future__ import annotations

import numpy as np

from contact_locking.errors import NotConverged
from contact_locking.solver.fixed_point import fixed_point
from contact_locking.solver.newton import NewtonSolver
from contact_locking.solver.polish import INNER_SHARE
from contact_locking.solver.saved import SavedState
from contact_locking.solver.task import Task

# Newton's steps for one friction bound, and the updates of the bound.
_MOST_STEPS, _MOST_UPDATES = 12, 12
# Steps of 1 % of the load leave residuals (relative to the forces) of 150 at most after the first
# step and of 6 three steps later.  With many times more Newton's method hardly arrives.
_NEAR, _ARRIVES = 500.0, {3: 50.0}
# The equilibrium needs to be this much sharper than the last change of the friction bound, and at
# the first bound this sharp.
_SHARE_OF_CHANGE, _FIRST = 1e-2, 1e-3


def step_on(saved: SavedState, task: Task) -> bool:
    """Whether Newton's method arrives from the step before; collective.

    If Newton's method does not arrive, the displacement and the friction bounds are of no use.
    """
    settings, system, report = task.settings, task.system, task.report
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
            return False
        _settle(newton, few)
    except NotConverged:
        return False
    finally:
        newton.destroy()
    report.multipliers = None
    return True


def _first_step(newton: NewtonSolver, saved: SavedState, task: Task) -> None:
    """A Newton step from slip zero with the secant of friction; collective."""
    contacts = task.system.contacts
    bounds = [contact.bounds for contact in contacts]
    for contact, bound, slip in zip(contacts, bounds, saved.slips, strict=True):
        # At slip zero this bound has the secant of the whole bound as its tangent.
        length = float(contact.regularisation.value)
        contact.bounds = bound * length / np.hypot(slip, length) if length > 0.0 else bound
    newton.step()
    for contact, bound in zip(contacts, bounds, strict=True):
        contact.bounds = bound


def _settle(newton: NewtonSolver, task: Task) -> None:
    """Solve to the tolerances, at first only as sharply as the friction bound is known."""
    tolerance, report = task.settings.tolerance, task.report
    report.friction_change = None

    def solve() -> None:
        change = report.friction_change
        wanted = _FIRST if change is None else min(_SHARE_OF_CHANGE * change, _FIRST)
        newton.solve(max(INNER_SHARE * tolerance, wanted), least_steps=1)

    fixed_point(task, solve, task.system.penalty_bounds)
    newton.solve(tolerance)
