"""Solves in which the friction bound follows the displacement, and what they save."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NoReturn

import numpy as np
import pytest
from petsc4py import PETSc
from problems import block
from slow import slow

from contact_locking.process import solving
from contact_locking.results.solution import StudySolution
from contact_locking.solver.interior_point.bound_step import BoundStep
from contact_locking.solver.interior_point.family import Direction
from contact_locking.solver.interior_point.iterate import Corrections, Iterate
from contact_locking.solver.interior_point.search import Search
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.linear import tangent_solver
from contact_locking.solver.linear.factorised import FILTER_LIMIT
from contact_locking.solver.linear.filtered_multigrid import FilteredMultigrid, StiffPart
from contact_locking.solver.linear.gmres import Gmres

_NODES, _FREE = 60, 3


def _refuse(*_: object) -> NoReturn:
    raise AssertionError("only a filter is asked for")


def _chain(stiffness: float) -> PETSc.Mat:
    """Springs between neighbours and to the ground, of this stiffness from node 10 to node 30."""
    matrix = PETSc.Mat().createBAIJ((_FREE * _NODES, _FREE * _NODES), _FREE, nnz=3)
    for i in range(*matrix.getOwnershipRange()):
        for j in (i - _FREE, i + _FREE):
            spring = stiffness if all(10 <= k // _FREE <= 30 for k in (i, j)) else 1.0
            matrix.setValue(i, i, spring, addv=PETSc.InsertMode.ADD)
            if 0 <= j < _FREE * _NODES:
                matrix.setValue(i, j, -spring, addv=PETSc.InsertMode.ADD)
    matrix.assemble()
    return matrix


@pytest.fixture
def filtered() -> Iterator[tuple[PETSc.Mat, FilteredMultigrid]]:
    """A chain of springs in three directions with a stiff part, and its filtered multigrid."""
    chain, soft = _chain(1e6), _chain(1.0)
    first, last = (k // _FREE for k in chain.getOwnershipRange())
    stiff = np.array([k - first for k in range(first, last) if 10 <= k <= 30], dtype=np.int32)
    multigrid = FilteredMultigrid(chain, 10**6)
    part = StiffPart(stiff, lambda: stiff, lambda matrix: soft.copy(matrix), _refuse, _refuse)
    multigrid.refresh(part)
    yield chain, multigrid
    multigrid.destroy()
    soft.destroy()
    chain.destroy()


def _random(like: PETSc.Mat, seed: int) -> PETSc.Vec:
    vector = like.createVecRight()
    values = np.random.default_rng(seed).standard_normal(vector.getSize())
    vector.array_w[:] = values[slice(*vector.getOwnershipRange())]
    return vector


def test_the_preconditioner_for_any_residual_is_symmetric_and_exact_where_it_filters(
    filtered: tuple[PETSc.Mat, FilteredMultigrid],
) -> None:
    matrix, multigrid = filtered
    r, s = _random(matrix, 0), _random(matrix, 1)
    z, y, left = r.duplicate(), r.duplicate(), r.duplicate()
    multigrid.apply_to_any(r, z)
    multigrid.apply_to_any(s, y)
    # The exact solve leaves rounding times the contrast of 1e6.
    assert z.dot(s) == pytest.approx(r.dot(y), rel=1e-8)
    matrix.mult(z, left)
    left.aypx(-1.0, r)
    first = matrix.getOwnershipRange()[0]
    nodes = (first + np.arange(len(left.array_r))) // _FREE
    inside = (nodes >= 10) & (nodes <= 30)
    assert np.all(np.abs(left.array_r[inside]) < 1e-6)
    for vector in (r, s, z, y, left):
        vector.destroy()


@pytest.mark.parametrize("start", [0.0, 1.0], ids=["from nothing", "from anything"])
def test_what_follows_the_displacement_without_symmetry_is_solved_for(
    filtered: tuple[PETSc.Mat, FilteredMultigrid], start: float
) -> None:
    # The residual of a start that bends what is stiff is 1e6 times the right-hand side.
    matrix, multigrid = filtered
    right, towards, seen = (_random(matrix, seed) for seed in range(3))
    towards.scale(1.0 / towards.norm())
    seen.scale(0.5 / seen.norm())

    def follow(x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.axpy(seen.dot(x), towards)

    heard: list[int] = []
    solver = Gmres(matrix, multigrid, {}, heard.append)
    x, left = _random(matrix, 3), right.duplicate()
    x.scale(start)
    asked = 1e-6 * right.norm()
    count, found = solver.solve(right, x, asked, 200, follow)
    matrix.mult(x, left)
    follow(x, left)
    left.aypx(-1.0, right)
    assert left.norm() == pytest.approx(found)
    assert found <= asked
    assert 0 < count <= 40
    assert max(heard) <= count
    solver.destroy()
    for vector in (right, towards, seen, x, left):
        vector.destroy()


def _solved(coefficient: float = 0.3) -> StudySolution:
    solution = solving.solve(
        block(
            3,
            1 / 6,
            mesh__structured=True,
            penalty__n=math.inf,
            friction__coefficient=coefficient,
            solver__linear="iterative",
        )
    )
    assert solution.converged, solution.summary["reason"]
    return solution


def _project(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_PATIENCE_OF_PROJECTION", "_LONGER_PATIENCE"):
        monkeypatch.setattr(tangent_solver, name, 0)
    monkeypatch.setitem(FILTER_LIMIT, (3, 1), 0)


def _filter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tangent_solver, "_PATIENCE", {3: 0})


@pytest.mark.parametrize("prepare", [_project, _filter], ids=["projected", "filtered"])
@pytest.mark.parametrize("coefficient", [slow(0.3), 4.0])
def test_a_step_solved_jointly_agrees_with_its_friction_bound(
    monkeypatch: pytest.MonkeyPatch,
    prepare: Callable[[pytest.MonkeyPatch], None],
    coefficient: float,
) -> None:
    prepare(monkeypatch)
    missed: list[float] = []
    joint = Search._joint

    def noted(
        self: Search, bound_step: BoundStep, target: float, corrections: Corrections
    ) -> Direction:
        direction = joint(self, bound_step, target, corrections)
        missed.append(bound_step.misses(direction))
        return direction

    monkeypatch.setattr(Search, "_joint", noted)
    monkeypatch.setattr(
        BoundStep, "adapt", lambda *_: pytest.fail("responses are for factorisations")
    )
    _solved(coefficient)
    # Where a bound would fall below zero, smaller steps keep it positive, and others miss a little.
    assert len(missed) > 10
    assert min(missed[6:]) < 1e-12
    assert max(missed[6:]) < 1e-3


@pytest.mark.slow
def test_a_joint_solve_takes_fewer_iterations_than_responses_to_the_friction_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _project(monkeypatch)
    jointly = _solved()
    monkeypatch.setattr(Tangent, "solves_following", False)
    by_responses = _solved()
    counts = [item.summary["iterations"]["linear"] for item in (jointly, by_responses)]
    assert counts[0] < 0.85 * counts[1]
    for key in ("compliance", "elastic_energy"):
        assert jointly.summary[key] == pytest.approx(by_responses.summary[key], rel=2e-7)


def test_the_last_step_is_balanced_from_rest_however_large_the_step_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A solve may fail where it starts a hundred thousand times farther away than rest is."""
    count = 0
    balance = Iterate.balanced

    def noted(self: Iterate, direction: Direction, t: float, accuracy: float) -> Direction:
        nonlocal count
        count += 1
        self.tangent._step.scale(1e9)
        return balance(self, direction, t, accuracy)

    monkeypatch.setattr(Iterate, "balanced", noted)
    monkeypatch.setattr(Search, "_linear_accuracy", lambda self, measures: 5e-9)
    assert _solved().summary["iterations"]["tangents"] < 20
    assert count
