"""Newton's method near a solution: full steps, and tangents that serve more than one bound."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from mpi4py import MPI
from petsc4py import PETSc
from problems import block

from contact_locking.errors import NotConverged
from contact_locking.laws.penalty import Penalty
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.newton import NewtonSolver
from contact_locking.solver.penalty_path import PenaltyPath
from contact_locking.solver.strategy import solve
from contact_locking.solver.task import Settings, Target, Task
from contact_locking.study.assembly import assemble

TOLERANCE = 1e-9
TARGET = Target(Penalty(10.0, 0.1, (0.1,)), 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)


@pytest.fixture
def system() -> PenalisedSystem:
    """The model case, where n is small enough for a start at zero, solved for its first bound."""
    made = assemble(block(h=0.1, penalty__n=10.0, penalty__epsilon=0.1), MPI.COMM_WORLD)
    system = PenalisedSystem(made.data, made.u, made.constraints)
    system.set_penalty(TARGET.penalty)
    for _ in range(2):
        newton = NewtonSolver(Task(system, TARGET))
        newton.solve(TOLERANCE)
        newton.destroy()
        system.update_bounds()
    return system


@pytest.fixture
def task(system: PenalisedSystem) -> Task:
    return Task(system, TARGET)


@pytest.fixture
def newton(task: Task) -> Iterator[NewtonSolver]:
    solver = NewtonSolver(task, near=True)
    yield solver
    solver.destroy()


def tangents_after(task: Task, newton: NewtonSolver, factor: float) -> int:
    """The number of tangents of a second solve with ``factor`` times the friction bound."""
    system, counts = task.system, task.counts
    newton.solve(TOLERANCE, least_steps=1)
    before = counts.tangents
    assert before > 0
    (contact,) = system.contacts
    system.bounds[contact] = factor * system.bounds[contact]
    newton.solve(TOLERANCE, least_steps=1)
    assert system.relative_residual() <= TOLERANCE
    return counts.tangents - before


def test_a_tangent_at_the_end_serves_the_next_friction_bound(
    task: Task, newton: NewtonSolver
) -> None:
    assert tangents_after(task, newton, 1.0 + 1e-7) == 0


def test_a_bound_that_is_far_away_gets_tangents_of_its_own(
    task: Task, newton: NewtonSolver
) -> None:
    assert tangents_after(task, newton, 1.3) > 0


def test_a_start_that_took_no_step_has_no_tangent_to_keep(task: Task, newton: NewtonSolver) -> None:
    newton.solve(1.0)
    assert task.counts.tangents == 0
    newton.solve(TOLERANCE, least_steps=1)
    assert task.counts.tangents > 0
    assert task.system.relative_residual() <= TOLERANCE


def test_full_steps_that_lead_away_are_given_up(task: Task, newton: NewtonSolver) -> None:
    # With a stiff penalty nothing of the soft one's solution is near.
    task.system.set_penalty(Penalty(1e8, 1e-8, (1e-8,)))
    start = task.system.u.x.array.copy()
    with pytest.raises(NotConverged):
        newton.solve(TOLERANCE)
    assert 0 < task.counts.tangents <= 2
    assert (task.system.u.x.array == start).all()


def test_the_last_steps_need_no_symbolic_factorisation_of_their_own(
    system: PenalisedSystem,
) -> None:
    PETSc.Log.begin()
    events = {name: PETSc.Log.Event(name) for name in ("MatCholFctrSym", "MatCholFctrNum")}

    def counts(name: str) -> int:
        return int(events[name].getPerfInfo()["count"])

    before = {name: counts(name) for name in events}
    system.clear()
    report = solve("interior_point", Task(system, TARGET))
    # Newton was the last to solve: the multipliers are those of the penalty laws.
    assert report.converged and report.multipliers is None
    assert system.relative_residual() <= Settings().tolerance
    assert counts("MatCholFctrSym") - before["MatCholFctrSym"] == 1
    assert counts("MatCholFctrNum") - before["MatCholFctrNum"] == report.tangents


def test_the_path_of_penalties_ends_at_the_target_and_starts_no_stiffer() -> None:
    target = Target(Penalty(1e4, 1e-4, (1e-3, 10.0)), 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    path = PenaltyPath.towards(target)
    assert path.at(1.0) == target.penalty
    # The second contact is softer than where the others start.
    assert path.start == Penalty(10.0, 0.1, (0.1, 10.0))
    assert path.decades == pytest.approx(3.0)
    assert path.at(0.5).n == pytest.approx(math.sqrt(1e5))
    inequality = target.penalty.inequality()
    assert inequality.is_inequality and not target.penalty.is_inequality
    assert inequality == Penalty(math.inf, 0.0, (0.0, 0.0)) and inequality.compliance == 0.0
