"""The part of a matrix that one rank has: its factor and its Schur complement are exact."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from grid_matrix import RIGHT, grid
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.solver.linear.direct import substructure
from contact_locking.solver.linear.direct.substructure import Substructure, cholmod, is_available

needs_cholmod = pytest.mark.skipif(
    not is_available(MPI.COMM_WORLD), reason="CHOLMOD is not installed, or has no header"
)


def test_where_cholmod_has_a_header_it_is_used_unless_switched_off(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CONTACT_LOCKING_NATIVE", raising=False)
    assert is_available(comm) == (cholmod() is not None)
    monkeypatch.setenv("CONTACT_LOCKING_NATIVE", "0")
    assert not is_available(comm)


@pytest.mark.parametrize("bits", [64, 32])
def test_other_indices_than_those_of_cholmod_are_refused(
    bits: int, comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CONTACT_LOCKING_NATIVE", raising=False)
    monkeypatch.setattr(substructure, "INDEX", np.dtype(f"int{bits}"))
    assert is_available(comm) == (bits == 32 and cholmod() is not None)


@needs_cholmod
def test_the_file_compiles_by_itself_without_warnings(tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no compiler by this name")
    words = ["-std=c17", "-Wall", "-Wextra", "-Werror", "-fopenmp-simd"]
    include = f"-I{cholmod()}/include"
    source = Path(substructure.__file__).with_name("substructure.c")
    subprocess.run(
        [compiler, *words, include, "-c", source, "-o", tmp_path / "substructure.o"], check=True
    )


@needs_cholmod
@pytest.mark.parametrize("count", [1, 60, 285, 286, 287, 288])
def test_the_corner_of_a_factor_is_that_of_the_schur_complement(
    count: int, comm: MPI.Intracomm
) -> None:
    whole = grid(1e4, 12)
    size = whole.shape[0]
    numbers = np.random.default_rng(1).permutation(size).astype(np.int32)
    corner, interior = np.sort(numbers[:count]), np.sort(numbers[count:])
    matrix = PETSc.Mat().createAIJ(
        (size, size), csr=(whole.indptr, whole.indices, whole.data), comm=PETSc.COMM_SELF
    )
    piece = Substructure(matrix, interior, corner, comm)
    assert (np.sort(piece.order[: size - count]) == interior).all()
    for values in (whole.data, 2.0 * whole.data):
        assert piece.factorise(values)
    dense = 2.0 * whole.toarray()
    inside, across = dense[np.ix_(interior, interior)], dense[np.ix_(corner, interior)]
    expected = dense[np.ix_(corner, corner)] - across @ np.linalg.solve(inside, across.T)
    backwards = expected[::-1, ::-1]
    assert np.triu(piece.complement()) == pytest.approx(np.triu(backwards), rel=1e-10, abs=1e-10)
    # Solves are in the order of elimination, and the corner backwards.
    order = piece.order[: size - count]
    b = RIGHT[:size]
    force = -dense[np.ix_(corner, order)] @ np.linalg.solve(dense[np.ix_(order, order)], b[order])
    assert piece.forward(b[order]) == pytest.approx(force[::-1], abs=1e-10)
    x = np.linalg.solve(dense, b)
    assert piece.backward(x[corner][::-1]) == pytest.approx(
        np.linalg.solve(
            dense[np.ix_(order, order)], b[order] - dense[np.ix_(order, corner)] @ x[corner]
        ),
        abs=1e-10,
    )
    matrix.destroy()


@needs_cholmod
def test_what_is_not_positive_definite_has_no_factor(comm: MPI.Intracomm) -> None:
    whole = grid(side=12)
    matrix = PETSc.Mat().createAIJ(
        whole.shape, csr=(whole.indptr, whole.indices, whole.data), comm=PETSc.COMM_SELF
    )
    numbers = np.arange(whole.shape[0], dtype=np.int32)
    piece = Substructure(matrix, numbers[:-10], numbers[-10:], comm)
    assert not piece.factorise(-whole.data)
    assert piece.factorise(whole.data)
    matrix.destroy()
