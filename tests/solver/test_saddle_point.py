"""With the forces of stiff points as unknowns, a factor in single precision is precise enough."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NoReturn

import numpy as np
import pytest
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.solver.linear.direct import substructuring
from contact_locking.solver.linear.direct.native import is_available
from contact_locking.solver.linear.filtered_multigrid import FilteredMultigrid, StiffPart
from contact_locking.solver.linear.gmres import Gmres

_NODES, _SIZE = 60, 3
_STIFF = range(10, 30)
# In the stiff part, whose rows an inexact factor does not keep apart.
_TOUCHING = 20
IN_PIECES = MPI.COMM_WORLD.size > 1 and is_available(MPI.COMM_WORLD)


def _refuse(*_: object) -> NoReturn:
    raise AssertionError("only a projection is asked for")


def _springs() -> sp.csr_matrix:
    """Soft springs between neighbours and to the ground, in three directions."""
    unknowns = _NODES * _SIZE
    between = sp.eye(unknowns, k=_SIZE) - sp.eye(unknowns)
    return sp.csr_matrix(between.T @ between + sp.eye(unknowns))


def _rows() -> sp.csr_matrix:
    """The stretch of some springs, and the displacement of one node along the first direction.

    The rows are in the order of the nodes.
    """
    ends = np.array([node * _SIZE + along for node in _STIFF for along in range(_SIZE)])
    number = np.arange(len(ends))
    stretches = sp.csr_matrix(
        (np.repeat([-1.0, 1.0], len(ends)), (np.tile(number, 2), np.r_[ends, ends + _SIZE])),
        shape=(len(ends), _NODES * _SIZE),
    )
    touching = sp.csr_matrix(([1.0], ([0], [_TOUCHING * _SIZE])), shape=(1, _NODES * _SIZE))
    rows = sp.csr_matrix(sp.vstack([stretches, touching]))
    rows = rows[np.argsort(np.append(ends, _TOUCHING * _SIZE), kind="stable")]
    rows.sort_indices()
    return rows


def _distributed(
    whole: sp.csr_matrix, rows: tuple[int, int], columns: tuple[int, int], kind: str
) -> PETSc.Mat:
    part = whole[slice(*rows)]
    sizes = tuple((last - first, None) for first, last in (rows, columns))
    matrix = PETSc.Mat().createAIJ(
        sizes, csr=(part.indptr, part.indices, part.data), comm=PETSc.COMM_WORLD
    )
    if kind == "baij":
        matrix.setBlockSize(_SIZE)
        return matrix.convert(kind)
    return matrix


class _Chain:
    """A chain of springs with a stiff part and a stiff point of contact."""

    def __init__(self, stiffness: float) -> None:
        comm = MPI.COMM_WORLD
        first, last = (_NODES * k // comm.size * _SIZE for k in (comm.rank, comm.rank + 1))
        rows = _rows()
        of_node = rows.indices[rows.indptr[:-1]]
        mine = int(np.searchsorted(of_node, first)), int(np.searchsorted(of_node, last))
        soft = _springs()
        whole = sp.csr_matrix(soft + stiffness * rows.T @ rows)
        span = first, last
        self.matrix = _distributed(whole, span, span, "baij")
        self.soft = _distributed(soft, span, span, "baij")
        self.stiffness, self.mine, self.span = stiffness, mine, span
        self.rows = rows

    def part(self) -> StiffPart:
        every = np.arange((self.span[1] - self.span[0]) // _SIZE, dtype=np.int32)

        def find_rows() -> tuple[PETSc.Mat, FloatArray]:
            count = self.mine[1] - self.mine[0]
            found = _distributed(self.rows, self.mine, self.span, "aij")
            return found, np.full(count, self.stiffness)

        def assemble_across(matrix: PETSc.Mat) -> None:
            self.soft.copy(matrix)

        return StiffPart(every, _refuse, _refuse, find_rows, assemble_across)

    def rub(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Add friction of 0.3 times the pressure: it follows the displacement, without symmetry."""
        place = _TOUCHING * _SIZE
        if self.span[0] <= place < self.span[1]:
            pressure = self.stiffness * x.array_r[place - self.span[0]]
            y.array_w[place + 1 - self.span[0]] += 0.3 * pressure


@pytest.fixture
def create() -> Iterator[Callable[[float], _Chain]]:
    made: list[_Chain] = []

    def one(stiffness: float) -> _Chain:
        made.append(_Chain(stiffness))
        return made[-1]

    yield one
    for chain in made:
        chain.matrix.destroy()
        chain.soft.destroy()


# A start that stretches what is 1e12 times as stiff leaves no digits for the rest.
@pytest.mark.parametrize(
    ("stiffness", "start"), [(1e4, 0.0), (1e4, 1.0), (1e8, 0.0), (1e8, 1.0), (1e12, 0.0)]
)
@pytest.mark.parametrize("follows", [False, True], ids=["alone", "with friction"])
def test_the_displacement_balances_the_forces_to_the_digits_asked_for(
    create: Callable[[float], _Chain],
    stiffness: float,
    start: float,
    follows: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chain = create(stiffness)
    monkeypatch.setattr(substructuring, "_LARGEST_SHARE", 1.0)
    multigrid = FilteredMultigrid(chain.matrix, 0)
    multigrid.in_single = True
    multigrid.refresh(chain.part())
    projection = multigrid.projection
    assert projection is not None
    assert projection.in_single == IN_PIECES
    # An exact factor does as well.
    projection.in_single = True
    solver = Gmres(chain.matrix, multigrid, {}, lambda _: None)
    right, x, left = (chain.matrix.createVecRight() for _ in range(3))
    random = np.random.default_rng(0).standard_normal((2, _NODES * _SIZE))
    right.array_w[:], x.array_w[:] = random[:, slice(*chain.span)]
    x.scale(start)
    asked = 1e-7 * right.norm()
    if follows:
        count, found = solver.solve_following(chain.rub, right, x, asked, 60)
    else:
        count, found = solver.solve(right, x, asked, 60)
    chain.matrix.mult(x, left)
    if follows:
        chain.rub(x, left)
    left.aypx(-1.0, right)
    assert found <= asked
    # A displacement has no more digits than this, where something is stiff.
    rounding = 1e-15 * chain.stiffness * x.norm(PETSc.NormType.NORM_INFINITY)
    assert left.norm() <= asked + 10.0 * rounding
    assert 0 < count <= 40
    solver.destroy()
    multigrid.destroy()
    for vector in (right, x, left):
        vector.destroy()


def test_what_single_precision_cannot_factorise_is_factorised_in_double(
    create: Callable[[float], _Chain], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(substructuring, "_LARGEST_SHARE", 1.0)
    chain = create(1e12)
    # The same spring three times over: T is singular but for the compliance.
    chain.rows = sp.csr_matrix(chain.rows[np.repeat(np.arange(chain.rows.shape[0]), 3)])
    chain.mine = 3 * chain.mine[0], 3 * chain.mine[1]
    multigrid = FilteredMultigrid(chain.matrix, 0)
    multigrid.in_single = True
    for _ in range(2):
        multigrid.refresh(chain.part())
        assert multigrid.projection is not None
        assert not multigrid.projection.in_single
    assert multigrid.in_single != IN_PIECES
    multigrid.destroy()
