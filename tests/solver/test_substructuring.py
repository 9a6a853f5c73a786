"""A direct solver of which each rank has a part: what is between the parts, and all together."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from grid_matrix import RIGHT, SIDE, grid
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.solver.linear.direct import substructuring
from contact_locking.solver.linear.direct.substructure import is_available
from contact_locking.solver.linear.direct.substructuring import Separator
from contact_locking.solver.linear.ksp import create_ksp, destroy_ksp, direct_options
from contact_locking.solver.linear.options import PREFIX

SEVERAL = MPI.COMM_WORLD.size > 1
IN_PIECES = SEVERAL and is_available(MPI.COMM_WORLD)
needs_cholmod = pytest.mark.skipif(
    not is_available(MPI.COMM_WORLD), reason="CHOLMOD is not installed, or has no header"
)


@pytest.fixture
def distributed(comm: MPI.Intracomm) -> Iterator[Callable[[sp.csr_matrix], PETSc.Mat]]:
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


@pytest.fixture(autouse=True)
def _small_matrices_have_large_separators(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(substructuring, "_LARGEST_SHARE", 1.0)


@pytest.fixture
def ksp(comm: MPI.Intracomm) -> Iterator[PETSc.KSP]:
    solver = create_ksp(comm, direct_options(comm), prefix="tested_")
    yield solver
    destroy_ksp(solver)


def test_no_entry_is_between_the_interiors(
    comm: MPI.Intracomm, distributed: Callable[[sp.csr_matrix], PETSc.Mat]
) -> None:
    whole = grid()
    separator = Separator(distributed(whole))
    interiors = comm.allgather(separator.interior)
    mine = comm.allgather(separator.shared[separator.mine])
    every = np.concatenate([*interiors, *mine])
    assert sorted(every) == list(range(whole.shape[0]))
    for one in range(comm.size):
        for other in range(one):
            assert whole[interiors[one]][:, interiors[other]].nnz == 0
    untouched = np.delete(separator.shared, separator.touched)
    assert len(separator.touched) > 0
    assert whole[separator.interior][:, untouched].nnz == 0
    sizes = [len(interior) for interior in interiors]
    assert max(sizes) <= 1.1 * whole.shape[0] / comm.size
    assert separator.divides and len(separator.shared) <= max(2.5 * SIDE * (comm.size - 1), 2)


@pytest.mark.parametrize("contrast", [1.0, 1e10])
def test_the_pieces_together_solve_with_the_matrix(
    contrast: float, ksp: PETSc.KSP, distributed: Callable[[sp.csr_matrix], PETSc.Mat]
) -> None:
    whole = grid(contrast)
    x = solved(ksp, distributed(whole), RIGHT)
    scale = np.abs(whole) @ np.abs(x) + np.abs(RIGHT)
    assert np.max(np.abs(whole @ x - RIGHT) / scale) < 1e-13
    if IN_PIECES:
        assert ksp.getPC().getPythonContext().in_pieces


def test_ranks_without_rows_factorise_a_piece_like_the_others(
    ksp: PETSc.KSP, distributed: Callable[..., PETSc.Mat]
) -> None:
    whole = grid()
    x = solved(ksp, distributed(whole, is_shared=False), RIGHT)
    assert whole @ x == pytest.approx(RIGHT, abs=1e-11)
    if IN_PIECES:
        assert ksp.getPC().getPythonContext().in_pieces


def test_a_matrix_may_fall_apart_by_itself(
    ksp: PETSc.KSP, distributed: Callable[[sp.csr_matrix], PETSc.Mat]
) -> None:
    whole = sp.csr_matrix(sp.block_diag([grid(side=20)] * 4))
    assert whole @ solved(ksp, distributed(whole), RIGHT) == pytest.approx(RIGHT, abs=1e-11)


def test_new_values_need_no_new_separator_and_another_matrix_does(
    ksp: PETSc.KSP,
    distributed: Callable[[sp.csr_matrix], PETSc.Mat],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[Separator] = []

    def counted(matrix: PETSc.Mat) -> Separator:
        made.append(Separator(matrix))
        return made[-1]

    monkeypatch.setattr(substructuring, "Separator", counted)
    whole = grid()
    matrix = distributed(whole)
    first = solved(ksp, matrix, RIGHT)
    matrix.scale(2.0)
    assert solved(ksp, matrix, RIGHT) == pytest.approx(first / 2.0, rel=1e-10)
    assert len(made) == (1 if IN_PIECES else 0)
    stiffer = sp.csr_matrix(whole + 10.0 * sp.identity(whole.shape[0]))
    x = solved(ksp, distributed(stiffer), RIGHT)
    assert stiffer @ x == pytest.approx(RIGHT, abs=1e-12)


@pytest.mark.skipif(not IN_PIECES, reason="other packages factorise what is not definite, too")
@pytest.mark.parametrize("place", ["first", "last", "on the separator"])
def test_all_ranks_learn_that_a_matrix_is_not_positive_definite(
    place: str, ksp: PETSc.KSP, distributed: Callable[[sp.csr_matrix], PETSc.Mat]
) -> None:
    whole = grid()
    shared = Separator(distributed(whole)).shared
    spoilt = {"first": 0, "last": whole.shape[0] - 1, "on the separator": int(shared[0])}[place]
    whole[spoilt, spoilt] = -1.0
    with pytest.raises(PETSc.Error):
        solved(ksp, distributed(whole), RIGHT)


@pytest.mark.parametrize("largest", [5000, 0], ids=["in pieces", "whole"])
def test_a_singular_matrix_is_an_error(
    largest: int,
    ksp: PETSc.KSP,
    distributed: Callable[[sp.csr_matrix], PETSc.Mat],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(substructuring, "_LARGEST", largest)
    whole = grid()
    kept = sp.diags(np.arange(whole.shape[0]) != 7, dtype=float)
    with pytest.raises(PETSc.Error):
        solved(ksp, distributed(sp.csr_matrix(kept @ whole @ kept)), RIGHT)


@pytest.mark.parametrize(
    "reason",
    ["a large separator", "switched off", "no such partitioner", "a part for one rank only"],
)
def test_mumps_takes_over_for(
    reason: str,
    request: pytest.FixtureRequest,
    ksp: PETSc.KSP,
    distributed: Callable[[sp.csr_matrix], PETSc.Mat],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if reason == "a large separator":
        monkeypatch.setattr(substructuring, "_LARGEST", 10)
    elif reason == "switched off":
        monkeypatch.setenv("CONTACT_LOCKING_NATIVE", "0")
    elif reason == "no such partitioner":
        options = PETSc.Options(PREFIX + "separator_")
        options.setValue("mat_partitioning_type", "nonsense")
        request.addfinalizer(lambda: options.delValue("mat_partitioning_type"))
    else:
        monkeypatch.setattr(
            "contact_locking.solver.linear.direct.substructuring._partition",
            lambda counts, *_: np.zeros(len(counts), dtype=np.int32),
        )
    whole = grid()
    assert whole @ solved(ksp, distributed(whole), RIGHT) == pytest.approx(RIGHT, abs=1e-11)
    if SEVERAL:
        assert not ksp.getPC().getPythonContext().in_pieces


@pytest.mark.parametrize(
    "options",
    [
        {"pc_type": "cholesky"},
        {"pc_factor_mat_solver_type": "mumps"},
        {"mat_mumps_icntl_14": 50},
        {"pc_type": "lu", "pc_factor_mat_solver_type": "superlu_dist"},
    ],
    ids=lambda options: ", ".join(options),
)
def test_whoever_says_anything_of_packages_gets_them(
    options: dict[str, Any],
    comm: MPI.Intracomm,
    distributed: Callable[[sp.csr_matrix], PETSc.Mat],
) -> None:
    ksp = create_ksp(comm, direct_options(comm), options, prefix="asked_")
    whole = grid()
    assert whole @ solved(ksp, distributed(whole), RIGHT) == pytest.approx(RIGHT, abs=1e-11)
    assert ksp.getPC().getType() == options.get("pc_type", "cholesky")
    if SEVERAL:
        package = options.get("pc_factor_mat_solver_type", "mumps")
        assert ksp.getPC().getFactorSolverType() == package
    destroy_ksp(ksp)


@needs_cholmod
@pytest.mark.serial
@pytest.mark.parametrize("ranks", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_more_ranks_than_two(ranks: int) -> None:
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        pytest.skip("mpirun is not installed")
    this = f"{Path(__file__)}::{test_the_pieces_together_solve_with_the_matrix.__name__}"
    between = f"{Path(__file__)}::{test_no_entry_is_between_the_interiors.__name__}"
    apart = f"{Path(__file__)}::{test_a_matrix_may_fall_apart_by_itself.__name__}"
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", this, between, apart]
    done = subprocess.run(
        [mpirun, "-n", str(ranks), sys.executable, *words],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed" in done.stdout
