"""Options of PETSc: they reach what asks for them, and those that nothing asks for are told."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI
from petsc4py import PETSc
from problems import SMALL_BLOCK, block

from contact_locking import solve
from contact_locking.command import cli
from contact_locking.solver.ksp import PREFIX, UserOptions, create_ksp, destroy_ksp


@pytest.fixture
def matrix(comm: MPI.Intracomm) -> Iterator[PETSc.Mat]:
    """The Laplacian on a line of 1000 nodes."""
    matrix = PETSc.Mat().createAIJ(1000, nnz=3, comm=comm)
    for row in range(*matrix.getOwnershipRange()):
        for column, value in ((row - 1, -1.0), (row, 2.0), (row + 1, -1.0)):
            if 0 <= column < 1000:
                matrix.setValue(row, column, value)
    matrix.assemble()
    yield matrix
    matrix.destroy()


def left() -> dict[str, Any]:
    return dict(PETSc.Options().getAll())


@pytest.mark.serial
def test_a_misspelt_option_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "study.yml"
    file.write_text(SMALL_BLOCK + "solver: {petsc: {ksp_type: cg, ksp rtol: 1e-3}}\n")
    out = ["--output", str(tmp_path / "out")]
    assert cli.main(["run", str(file), *out, "--", "-pc_tpye", "gamg"]) == 0
    told = capsys.readouterr()
    warning = "PETSc has not used these options: ksp rtol, pc_tpye (solver.petsc, or after --)"
    assert warning in told.out + told.err


def test_levels_of_multigrid_get_their_options_and_the_database_is_left_clean(
    matrix: PETSc.Mat,
) -> None:
    before = left()
    user = UserOptions({"mg_levels_ksp_max_it": 7, "mg_levels_pc_type": "sor", "snes_rtol": 1e-3})
    ksp = create_ksp(matrix.getComm(), {"ksp_type": "cg", "pc_type": "gamg"}, user)
    ksp.setOperators(matrix)
    ksp.setUp()
    smoother = ksp.getPC().getMGSmoother(ksp.getPC().getMGLevels() - 1)
    assert smoother.getTolerances()[3] == 7
    assert smoother.getPC().getType() == "sor"
    destroy_ksp(ksp)
    assert user.used >= {"mg_levels_ksp_max_it", "mg_levels_pc_type"}
    assert user.unused() == ["snes_rtol"]
    assert left() == before


def test_a_solver_takes_the_options_of_the_user_and_none_of_another_solver(
    comm: MPI.Intracomm,
) -> None:
    before = left()
    PETSc.Options().setValue(f"{PREFIX}ksp_rtol", 1e-3)
    try:
        other = create_ksp(comm, {"ksp_type": "gmres", "ksp_max_it": 7}, {"pc_type": "jacobi"})
        ksp = create_ksp(comm, {"ksp_type": "cg"})
        assert (ksp.getType(), ksp.getPC().getType()) == ("cg", None)
        assert ksp.getTolerances()[0] == other.getTolerances()[0] == 1e-3
        assert ksp.getTolerances()[3] != other.getTolerances()[3] == 7
        destroy_ksp(other)
        destroy_ksp(ksp)
        assert UserOptions().unused() == []
    finally:
        PETSc.Options().delValue(f"{PREFIX}ksp_rtol")
    assert left() == before


def test_a_value_that_petsc_refuses_leaves_the_database_clean(comm: MPI.Intracomm) -> None:
    before = left()
    with pytest.raises(PETSc.Error):
        create_ksp(comm, {}, UserOptions({"ksp_type": "nonsense"}))
    assert left() == before


def test_what_had_no_effect_is_a_warning(comm: MPI.Intracomm) -> None:
    petsc = {"ksp_type": "preonly", "mg_levels_ksp_max_it": 2, "snes_rtol": 1e-3}
    PETSc.Options().setValue(f"{PREFIX}pc_gamg_threshold", 0.1)
    try:
        # n = inf needs no SNES, and a direct solver no multigrid.
        solution = solve(block(h=0.25, penalty__n=float("inf"), solver__petsc=petsc), comm)
    finally:
        PETSc.Options().delValue(f"{PREFIX}pc_gamg_threshold")
    (finding,) = [each for each in solution.warnings if each.code == "solver.unused_options"]
    assert finding.numbers["names"] == "mg_levels_ksp_max_it, snes_rtol, pc_gamg_threshold"


def test_options_of_the_default_multigrid_have_an_effect(comm: MPI.Intracomm) -> None:
    before, found = left(), []
    for petsc in ({}, {"multigrid_mg_levels_ksp_max_it": 5}):
        given = block(3, 0.25, penalty__n=1e3, solver__linear="iterative", solver__petsc=petsc)
        solution = solve(given, comm)
        assert "solver.unused_options" not in [each.code for each in solution.warnings]
        found.append(solution.summary["iterations"]["linear"])
    assert found[1] < found[0]
    assert left() == before


@pytest.mark.parametrize("name", ["ksp_type", "multigrid_pc_type"])
def test_a_value_that_the_iterative_solver_refuses_leaves_the_database_clean(
    name: str, comm: MPI.Intracomm
) -> None:
    before = left()
    with pytest.raises(PETSc.Error):
        solve(block(solver__linear="iterative", solver__petsc={name: "nonsense"}), comm)
    assert left() == before


def test_options_that_have_an_effect_are_no_warning(comm: MPI.Intracomm) -> None:
    petsc = {"ksp_type": "gmres", "pc_type": "gamg", "mg_levels_ksp_max_it": 4, "snes_max_it": 90}
    parameters = block(h=0.25, solver__method="penalty", penalty__n=10.0, solver__petsc=petsc)
    solution = solve(parameters, comm)
    assert solution.converged
    assert "solver.unused_options" not in [each.code for each in solution.warnings]


def test_an_unknown_factorisation_is_a_solve_that_fails_and_no_crash(comm: MPI.Intracomm) -> None:
    given = {"pc_factor_mat_solver_type": "nonsense"}
    assert not solve(block(h=0.25), comm, petsc_options=given).converged


def test_an_iterative_solver_takes_another_preconditioner(comm: MPI.Intracomm) -> None:
    petsc = {"pc_type": "jacobi", "ksp_rtol": 1e-10}
    energies = []
    for linear, given in (("iterative", petsc), ("direct", {})):
        parameters = block(h=0.25, penalty__n=1e2, solver__linear=linear, solver__petsc=given)
        energies.append(solve(parameters, comm).summary["elastic_energy"])
    assert energies[0] == pytest.approx(energies[1], rel=2e-7)
