"""The direct solver, on one rank or several: answers to rounding, and errors on all ranks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from dolfinx import mesh
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.mesh.parts import NamedFacets
from contact_locking.solver.ksp import create_ksp, destroy_ksp, direct_options, estimated_memory

SIDE = 40
RIGHT = np.random.default_rng(3).standard_normal(2 * SIDE**2)


def grid(contrast: float = 1.0, side: int = SIDE) -> sp.csr_matrix:
    """Two unknowns at each node of a square grid, coupled; stiffer to the right by a factor."""
    line = sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(side, side))
    stiffness = sp.diags(np.linspace(1.0, contrast, side) ** 0.5)
    nodes = sp.kronsum(stiffness @ line @ stiffness, line)
    return sp.csr_matrix(sp.kron(nodes, [[2.0, 1.0], [1.0, 3.0]]))


@pytest.fixture
def distributed(comm: MPI.Intracomm) -> Iterator[Callable[..., PETSc.Mat]]:
    """A matrix over the ranks, in blocks of two, of which the first rank has the most, or all."""
    made: list[PETSc.Mat] = []

    def distribute(whole: sp.csr_matrix, is_shared: bool = True) -> PETSc.Mat:
        nodes = whole.shape[0] // 2
        others = nodes // (2 * comm.size) if is_shared else 0
        local = 2 * (others if comm.rank else nodes - (comm.size - 1) * others)
        matrix = PETSc.Mat().create(comm)
        matrix.setSizes(((local, None), (local, None)), bsize=2)
        matrix.setType("aij")
        matrix.setUp()
        first, last = matrix.getOwnershipRange()
        part = whole[first:last]
        matrix.setPreallocationCSR((part.indptr, part.indices, part.data))
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        made.append(matrix)
        return matrix

    yield distribute
    for matrix in made:
        matrix.destroy()


def solved(ksp: PETSc.KSP, matrix: PETSc.Mat, right: FloatArray) -> FloatArray:
    """``A^-1 b``, gathered on every rank."""
    b, x = matrix.createVecs()
    b.array_w[:] = right[slice(*b.getOwnershipRange())]
    ksp.setOperators(matrix)
    ksp.solve(b, x)
    result = np.concatenate(matrix.getComm().tompi4py().allgather(x.array_r.copy()))
    b.destroy()
    x.destroy()
    return result


@pytest.fixture
def ksp(comm: MPI.Intracomm) -> Iterator[PETSc.KSP]:
    solver = create_ksp(comm, direct_options(comm))
    yield solver
    destroy_ksp(solver)


@pytest.mark.parametrize("contrast", [1.0, 1e10])
def test_solves_are_sharp_to_rounding_at_any_contrast(
    contrast: float, ksp: PETSc.KSP, distributed: Callable[..., PETSc.Mat]
) -> None:
    whole = grid(contrast)
    x = solved(ksp, distributed(whole), RIGHT)
    scale = np.abs(whole) @ np.abs(x) + np.abs(RIGHT)
    assert np.max(np.abs(whole @ x - RIGHT) / scale) < 1e-13


def test_ranks_may_have_no_rows(ksp: PETSc.KSP, distributed: Callable[..., PETSc.Mat]) -> None:
    whole = grid()
    x = solved(ksp, distributed(whole, is_shared=False), RIGHT)
    assert whole @ x == pytest.approx(RIGHT, abs=1e-11)


def test_new_values_and_another_matrix_are_factorised_anew(
    ksp: PETSc.KSP, distributed: Callable[..., PETSc.Mat]
) -> None:
    whole = grid()
    matrix = distributed(whole)
    first = solved(ksp, matrix, RIGHT)
    matrix.scale(2.0)
    assert solved(ksp, matrix, RIGHT) == pytest.approx(first / 2.0, rel=1e-10)
    stiffer = sp.csr_matrix(whole + 10.0 * sp.identity(whole.shape[0]))
    x = solved(ksp, distributed(stiffer), RIGHT)
    assert stiffer @ x == pytest.approx(RIGHT, abs=1e-12)


@pytest.mark.parametrize("place", [0, -1], ids=["first", "last"])
def test_a_singular_matrix_is_an_error_on_all_ranks(
    place: int, ksp: PETSc.KSP, distributed: Callable[..., PETSc.Mat]
) -> None:
    whole = grid()
    kept = np.ones(whole.shape[0])
    kept[place] = 0.0
    spoilt = sp.csr_matrix(sp.diags(kept) @ whole @ sp.diags(kept))
    with pytest.raises(PETSc.Error):
        solved(ksp, distributed(spoilt), RIGHT)


@pytest.mark.parametrize(
    "options",
    [
        {"pc_type": "cholesky"},
        {"pc_factor_mat_solver_type": "mumps"},
        {"pc_type": "lu", "pc_factor_mat_solver_type": "superlu_dist"},
    ],
    ids=lambda options: ", ".join(options),
)
def test_whoever_asks_for_a_package_gets_it(
    options: dict[str, Any], comm: MPI.Intracomm, distributed: Callable[..., PETSc.Mat]
) -> None:
    ksp = create_ksp(comm, direct_options(comm), options)
    whole = grid()
    assert whole @ solved(ksp, distributed(whole), RIGHT) == pytest.approx(RIGHT, abs=1e-11)
    assert ksp.getPC().getType() == options.get("pc_type", "cholesky")
    own = "cholmod" if comm.size == 1 else "mumps"
    package = options.get("pc_factor_mat_solver_type", own)
    assert ksp.getPC().getFactorSolverType() == package
    destroy_ksp(ksp)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("dim", "unknowns", "ranks", "gigabytes"),
    [
        (2, 8450, 1, 0.28),
        (2, 132_098, 1, 0.65),
        (3, 14_739, 1, 0.40),
        (3, 46_875, 1, 0.81),
        (3, 107_811, 2, 2.4),
        (3, 206_763, 2, 2.8),
        (3, 352_947, 2, 4.7),
        (3, 823_875, 2, 11.2),
    ],
)
def test_the_estimate_agrees_with_what_was_measured_within_a_factor_of_1_5(
    dim: int, unknowns: int, ranks: int, gigabytes: float
) -> None:
    found = estimated_memory("auto", dim, unknowns, unknowns, ranks) / 1e9
    assert gigabytes / 1.5 < found < 1.5 * gigabytes


def compact(degree: int, kind: str, *cells: int) -> tuple[int, int]:
    """The unknowns of a grid, and those of the cube that takes as long to factorise."""
    corners = [[0.0, 0.0, 0.0], [200.0, 100.0, 1.0]]
    grid = mesh.create_box(MPI.COMM_WORLD, corners, cells, getattr(mesh.CellType, kind))
    unknowns = 3 * math.prod(degree * count + 1 for count in cells)
    return unknowns, NamedFacets(grid).domain().compact_size(unknowns, degree)


@pytest.mark.parametrize("kind", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_a_cube_counts_by_its_unknowns_and_a_plate_by_its_separator(degree: int, kind: str) -> None:
    cube, as_cube = compact(degree, kind, 8, 8, 8)
    assert as_cube == cube
    _, as_plate = compact(degree, kind, 20, 20, 3)
    separator = (20 * degree + 1) * (3 * degree + 1)
    assert as_plate == pytest.approx(3 * separator**1.5, rel=1e-3)
