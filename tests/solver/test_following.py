"""Solves in which the friction bound follows the displacement, and what they save."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NoReturn

import numpy as np
import pytest
from petsc4py import PETSc

from contact_locking.solver import tangent_solver
from contact_locking.solver.multigrid import StiffPart
from contact_locking.solver.tangent_solver import MultigridTangents
from contact_locking.solver.task import Counts

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
def filtered(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[PETSc.Mat, MultigridTangents]]:
    """A chain of springs with a stiff part, and its solver, which filters at once."""
    chain, soft = _chain(1e6), _chain(1.0)
    first, last = (k // _FREE for k in chain.getOwnershipRange())
    stiff = np.array([k - first for k in range(first, last) if 10 <= k <= 30], dtype=np.int32)
    part = StiffPart(stiff, lambda: stiff, lambda matrix: soft.copy(matrix), _refuse, _refuse)
    monkeypatch.setattr(tangent_solver, "_PATIENCE", {3: 0})
    solver = MultigridTangents(chain, 3, 1, {}, lambda iteration: None, Counts())
    solver.refresh(lambda matrix: None, lambda: part)
    yield chain, solver
    solver.destroy()
    soft.destroy()
    chain.destroy()


def _random(like: PETSc.Mat, seed: int) -> PETSc.Vec:
    vector = like.createVecRight()
    values = np.random.default_rng(seed).standard_normal(vector.getSize())
    vector.array_w[:] = values[slice(*vector.getOwnershipRange())]
    return vector


def test_the_preconditioner_for_any_residual_is_symmetric_and_exact_where_it_filters(
    filtered: tuple[PETSc.Mat, MultigridTangents],
) -> None:
    matrix, solver = filtered
    r, s = _random(matrix, 0), _random(matrix, 1)
    z, y, left = r.duplicate(), r.duplicate(), r.duplicate()
    z.set(0.0)
    solver.solve(r, z, 1e-6)
    assert solver.filters
    solver._multigrid.apply(r, z)
    solver._multigrid.apply(s, y)
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
    filtered: tuple[PETSc.Mat, MultigridTangents], start: float
) -> None:
    # The residual of a start that bends what is stiff is 1e6 times the right-hand side.
    matrix, solver = filtered
    right, towards, seen = (_random(matrix, seed) for seed in range(3))
    towards.scale(1.0 / towards.norm())
    seen.scale(0.5 / seen.norm())

    def follow(x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.axpy(seen.dot(x), towards)

    x, left = _random(matrix, 3), right.duplicate()
    x.scale(start)
    asked = 1e-6 * right.norm()
    solver.solve(right, x, asked, follow=follow)
    assert solver.filters
    matrix.mult(x, left)
    follow(x, left)
    left.aypx(-1.0, right)
    assert left.norm() <= asked
    assert 0 < solver.counts.linear <= 40
    for vector in (right, towards, seen, x, left):
        vector.destroy()
