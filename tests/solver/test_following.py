"""Solves in which the friction bound follows the displacement, and what they save."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NoReturn

import numpy as np
import pytest
from petsc4py import PETSc

from contact_locking.solver.linear.gmres import Gmres
from contact_locking.solver.linear.multigrid import FilteredMultigrid, StiffPart

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
