"""Newton's method near a solution: full steps, and tangents that serve more than one bound."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from mpi4py import MPI
from petsc4py import PETSc
from problems import block

from contact_locking.assembly import assemble
from contact_locking.errors import NotConverged
from contact_locking.progress import Monitor
from contact_locking.solver.newton import NewtonSolver
from contact_locking.solver.report import Settings, SolverReport
from contact_locking.solver.strategy import solve
from contact_locking.solver.substructuring import Pieces
from contact_locking.solver.target import Target
from contact_locking.system import PenalisedSystem

TOLERANCE = 1e-9


@pytest.fixture
def system() -> PenalisedSystem:
    """The model case, where n is small enough for a start at zero, solved for its first bound."""
    made = assemble(block(h=0.1, penalty__n=10.0, penalty__epsilon=0.1), MPI.COMM_WORLD)
    system = PenalisedSystem(made.data, made.u, made.constraints)
    system.set_penalty(10.0, 0.1, [0.1])
    for _ in range(2):
        newton = NewtonSolver(system, Settings(), Monitor())
        newton.solve(TOLERANCE, SolverReport())
        newton.destroy()
        system.update_bounds()
    return system


@pytest.fixture
def newton(system: PenalisedSystem) -> Iterator[NewtonSolver]:
    solver = NewtonSolver(system, Settings(), Monitor(), near=True)
    yield solver
    solver.destroy()


def tangents_after(system: PenalisedSystem, newton: NewtonSolver, factor: float) -> int:
    """Those that a solve takes for ``factor`` times the bound of the solve before it."""
    report = SolverReport()
    newton.solve(TOLERANCE, report, least_steps=1)
    before = report.tangents
    assert before > 0
    (contact,) = system.contacts
    contact.bounds = factor * contact.bounds
    newton.solve(TOLERANCE, report, least_steps=1)
    assert system.relative_residual() <= TOLERANCE
    return report.tangents - before


def test_a_tangent_at_the_end_serves_the_next_friction_bound(
    system: PenalisedSystem, newton: NewtonSolver
) -> None:
    assert tangents_after(system, newton, 1.0 + 1e-7) == 0


def test_a_bound_that_is_far_away_gets_tangents_of_its_own(
    system: PenalisedSystem, newton: NewtonSolver
) -> None:
    assert tangents_after(system, newton, 1.3) > 0


def test_a_start_that_took_no_step_has_no_tangent_to_keep(
    system: PenalisedSystem, newton: NewtonSolver
) -> None:
    report = SolverReport()
    newton.solve(1.0, report)
    assert report.tangents == 0
    newton.solve(TOLERANCE, report, least_steps=1)
    assert report.tangents > 0
    assert system.relative_residual() <= TOLERANCE


def test_full_steps_that_lead_away_are_given_up(
    system: PenalisedSystem, newton: NewtonSolver
) -> None:
    # With a stiff penalty nothing of the soft one's solution is near.
    system.set_penalty(1e8, 1e-8, [1e-8])
    report = SolverReport()
    start = system.u.x.array.copy()
    with pytest.raises(NotConverged):
        newton.solve(TOLERANCE, report)
    assert 0 < report.tangents <= 2
    assert (system.u.x.array == start).all()


def test_the_last_steps_need_no_symbolic_factorisation_of_their_own(
    system: PenalisedSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Either PETSc has a package factorise, or each rank factorises its part.
    PETSc.Log.begin()
    events = {name: PETSc.Log.Event(name) for name in ("MatCholFctrSym", "MatCholFctrNum")}
    in_pieces = dict.fromkeys(events, 0)

    def count(name: str, function: Callable[..., None]) -> Callable[..., None]:
        def counted(*arguments: Any) -> None:
            in_pieces[name] += 1
            function(*arguments)

        return counted

    monkeypatch.setattr(Pieces, "__init__", count("MatCholFctrSym", Pieces.__init__))
    monkeypatch.setattr(Pieces, "factorise", count("MatCholFctrNum", Pieces.factorise))

    def counts(name: str) -> int:
        return int(events[name].getPerfInfo()["count"]) + in_pieces[name]

    before = {name: counts(name) for name in events}
    system.clear()
    target = Target(10.0, 0.1, (0.1,), 1.0, 1.0, 1.0, 1.0, 1.0)
    report = solve("interior_point", system, target, Settings(), Monitor())
    # Newton was the last to solve: the multipliers are those of the penalty laws.
    assert report.converged and report.multipliers is None
    assert system.relative_residual() <= Settings().tolerance
    assert counts("MatCholFctrSym") - before["MatCholFctrSym"] == 1
    assert counts("MatCholFctrNum") - before["MatCholFctrNum"] == report.tangents
