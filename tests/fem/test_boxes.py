"""Quadrilaterals and hexahedra: patch tests, limits, contact, friction and what is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boxes import write_distorted
from mpi4py import MPI
from msh import write_msh
from problems import solved
from small_meshes import EDGES, SQUARE, Points
from xdmf import export

from contact_locking import StudySolution, check, solve, study_file
from contact_locking.errors import InputError
from contact_locking.mesh.parts import groups
from contact_locking.mesh.sources import from_file
from contact_locking.running.assembly import mesh_of

DIMENSIONS = pytest.mark.parametrize("dim", [2, 3])
PRESSURE, LIMIT, YOUNG, POISSON = 0.05, 0.02, 1.0, 0.3
#: The stiffness in uniaxial strain.
STIFFNESS = YOUNG * (1.0 - POISSON) / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON))


def mesh(folder: Path, dim: int, parts: int = 3) -> str:
    """A file with distorted boxes, of rank 0 for all ranks."""
    path = folder / "boxes.msh"
    if MPI.COMM_WORLD.rank == 0:
        write_distorted(path, dim, parts)
    MPI.COMM_WORLD.Barrier()
    return str(path)


def pressed(file: str, dim: int, **changes: Any) -> Any:
    """A column in uniaxial strain that is pressed on a foundation."""
    fixed = [
        {"on": [low, high], "value": [0.0 if i == axis else None for i in range(dim)]}
        for axis, (low, high) in enumerate([("left", "right"), ("front", "back")][: dim - 1])
    ]
    data: dict[str, Any] = {
        "mesh": {"file": file},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}, "locking_limit": LIMIT},
        "loads": {
            "tractions": [{"on": "top", "value": [0.0] * (dim - 1) + [-PRESSURE]}],
            "displacements": fixed,
        },
        "contact": {"on": "bottom"},
        "output": {"picture": False},
    }
    return study_file.from_mapping(data | changes)


def indicated(solution: StudySolution) -> float:
    """The estimated error of the mesh, relative to the solution."""
    return float(solution.summary["certificate"]["errors"]["mesh"]["relative"])


@DIMENSIONS
@pytest.mark.parametrize("n", [1e3, np.inf])
def test_distorted_boxes_have_constant_stress_and_pressure_to_rounding(
    dim: int, n: float, folder: Path
) -> None:
    solution = solved(pressed(mesh(folder, dim), dim, penalty={"n": n, "epsilon": 1e-4}))
    exact = LIMIT + (PRESSURE - STIFFNESS * LIMIT) / (STIFFNESS + 2.0 * n)
    assert solution.summary["strain_norm_max"] == pytest.approx(exact, rel=1e-8)
    assert solution.summary["strain_norm_max_in_cells"] == pytest.approx(exact, rel=1e-8)
    # Where all of the body locks and n is infinite, its stress need not be unique.
    accuracy = 1e-7 if np.isfinite(n) else 1e-5
    assert solution.summary["penetration_max"] == pytest.approx(1e-4 * PRESSURE, rel=accuracy)
    points = solution.contact_points
    if points is not None:
        assert points.pressure == pytest.approx(PRESSURE, rel=accuracy)
        assert len(points.pressure) == 4 ** (dim - 1)


@DIMENSIONS
def test_an_elastic_column_is_exact_where_the_indicator_is_zero(dim: int, folder: Path) -> None:
    soft = {"elasticity": {"young": YOUNG, "poisson": POISSON}}
    solution = solved(pressed(mesh(folder, dim), dim, material=soft))
    stress = solution.elastic_stress.x.array.reshape(-1, dim, dim)
    assert stress[:, -1, -1] == pytest.approx(-PRESSURE, rel=1e-9)
    assert np.abs(stress[:, 0, -1]).max() < 1e-10 * PRESSURE
    assert indicated(solution) < 1e-8


def rubbed(file: str, dim: int, **changes: Any) -> Any:
    """A block that is pressed and dragged on a foundation with friction that R smooths."""
    push = [0.015] + [0.0] * (dim - 2) + [-PRESSURE]
    data = {
        "loads": {
            "tractions": [{"on": "top", "value": push}],
            "displacements": [{"on": "left", "value": [0.0] + [None] * (dim - 1)}],
        },
        "friction": {"coefficient": 0.3, "smoothing": {"radius": 0.5}},
    }
    return pressed(file, dim, **data | changes)


@DIMENSIONS
def test_friction_is_solved_alike_by_penalty_limit_and_multigrid(dim: int, folder: Path) -> None:
    file = mesh(folder, dim)
    exact = solved(rubbed(file, dim))
    assert exact.summary["friction_force"][0] < 0.0
    assert exact.summary["strain_norm_max"] == pytest.approx(LIMIT, rel=1e-6)
    smooth = solved(rubbed(file, dim, penalty={"n": 1e5}))
    largest = np.abs(exact.displacement.x.array).max()
    apart = np.abs(smooth.displacement.x.array - exact.displacement.x.array).max()
    assert apart < 2e-3 * largest
    iterative = solved(rubbed(file, dim, solver={"linear": "iterative"}))
    apart = np.abs(iterative.displacement.x.array - exact.displacement.x.array).max()
    assert apart < 1e-6 * largest


@DIMENSIONS
def test_any_number_of_ranks_has_one_solution(dim: int, folder: Path, comm: MPI.Intracomm) -> None:
    given = rubbed(mesh(folder, dim), dim)
    several, alone = solved(given), solve(given, MPI.COMM_SELF)
    assert indicated(several) == pytest.approx(indicated(alone), rel=1e-4)
    name = "strain_norm_max_in_cells"
    assert several.summary[name] == pytest.approx(alone.summary[name], rel=1e-5)
    for name in ("contact_force", "friction_force"):
        assert several.summary[name] == pytest.approx(alone.summary[name], rel=1e-6)


SQUARES: Points = [*SQUARE, (2.0, 0.0), (0.2, 0.1), (0.2, 0.9)]


@pytest.mark.serial
@pytest.mark.parametrize(
    ("cells", "words"),
    [
        ({"body": [(1, 2, 3, 4)], "more": [(2, 5, 3)]}, "in Gmsh's words"),
        ({"body": [(1, 3, 2, 4)]}, "is folded"),
        ({"body": [(1, 2, 3, 4), (4, 3, 2, 1)]}, "once more"),
        ({"body": [(1, 2, 3, 4), (2, 3, 7, 6)]}, "overlap"),
    ],
    ids=["mixed", "folded", "twice", "turned"],
)
def test_a_mesh_of_boxes_that_is_no_body_is_refused(
    cells: dict[str, Any], words: str, tmp_path: Path
) -> None:
    path = write_msh(tmp_path / "bad.msh", SQUARES, {**EDGES, **cells})
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        solve(pressed(str(path), 2))
    assert caught.value.key == "mesh.file"
    assert "kinds" not in words or "recombine" in str(caught.value)


@DIMENSIONS
def test_an_xdmf_file_has_the_same_boxes(dim: int, folder: Path, comm: MPI.Intracomm) -> None:
    given = rubbed(mesh(folder, dim), dim)
    domain = mesh_of(given, comm)
    export(domain, folder / "boxes.xdmf")
    again = from_file(folder / "boxes.xdmf", comm)
    assert again.kind is domain.kind and again.num_cells == domain.num_cells
    for one, other in zip(groups(again), groups(domain), strict=True):
        assert one.name == other.name and one.count == other.count
        assert one.measure == pytest.approx(other.measure)
    solution = solved(rubbed(str(folder / "boxes.xdmf"), dim))
    wanted = solved(given).summary["friction_force"]
    assert solution.summary["friction_force"] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.serial
def test_a_quadrilateral_with_a_hanging_neighbour_in_xdmf_is_refused(tmp_path: Path) -> None:
    # The edge from (1, 0) to (1, 1) of the first has the node (1, 0.5) of the others.
    points: Points = [*SQUARE, (2, 0), (2, 0.5), (1, 0.5), (2, 1)]
    cells = [(1, 2, 3, 4), (2, 5, 6, 7), (7, 6, 8, 3)]
    path = write_msh(tmp_path / "hanging.msh", points, {**EDGES, "body": cells})
    with pytest.raises(InputError, match=r"hangs: it lies on an edge of quadrilateral"):
        solve(pressed(str(path), 2))


@pytest.mark.serial
def test_boxes_of_degree_two_are_refused(folder: Path) -> None:
    file = mesh(folder, 2)
    assert check(pressed(file, 2), MPI.COMM_SELF)["cells"] == 9
    with pytest.raises(InputError) as caught:
        solve(pressed(file, 2, discretisation={"degree": 2}))
    assert caught.value.key == "discretisation.degree"
