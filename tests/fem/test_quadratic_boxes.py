"""Quadrilaterals and hexahedra of degree 2: patch tests, friction, multigrid, ranks, files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block
from test_boxes import (
    DIMENSIONS,
    LIMIT,
    POISSON,
    PRESSURE,
    STIFFNESS,
    YOUNG,
    indicated,
    mesh,
    pressed,
    rubbed,
    solved,
)

from contact_locking import solve
from contact_locking.extras.pictures.gather import gather
from contact_locking.parallel import maximum
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.process.solving import solve as solve_from
from contact_locking.results import fields, xdmf
from contact_locking.running import writing

QUADRATIC: dict[str, Any] = {"discretisation": {"degree": 2}}


@pytest.fixture
def folder(tmp_path: Path, comm: MPI.Intracomm) -> Path:
    """The same folder on all ranks."""
    found: Path = comm.bcast(tmp_path)
    return found


@DIMENSIONS
@pytest.mark.parametrize("n", [1e3, np.inf])
def test_distorted_boxes_have_constant_stress_and_pressure(
    dim: int, n: float, folder: Path
) -> None:
    given = pressed(mesh(folder, dim), dim, penalty={"n": n, "epsilon": 1e-4}, **QUADRATIC)
    solution = solved(given)
    exact = LIMIT + (PRESSURE - STIFFNESS * LIMIT) / (STIFFNESS + 2.0 * n)
    for name in ("strain_norm_max", "strain_norm_max_in_cells"):
        assert solution.summary[name] == pytest.approx(exact, rel=1e-8)
    accuracy = 1e-7 if np.isfinite(n) else 1e-5
    assert solution.summary["penetration_max"] == pytest.approx(1e-4 * PRESSURE, rel=accuracy)
    points = solution.contact_points
    if points is not None:
        assert points.pressure == pytest.approx(PRESSURE, rel=accuracy)
        assert len(points.pressure) == 7 ** (dim - 1)


@DIMENSIONS
def test_an_elastic_column_is_exact_where_the_indicator_is_zero(dim: int, folder: Path) -> None:
    soft = {"elasticity": {"young": YOUNG, "poisson": POISSON}}
    solution = solved(pressed(mesh(folder, dim), dim, material=soft, **QUADRATIC))
    stress = solution.elastic_stress.x.array.reshape(-1, dim, dim)
    assert stress[:, -1, -1] == pytest.approx(-PRESSURE, rel=1e-9)
    assert indicated(solution) < 1e-8


@DIMENSIONS
def test_friction_is_solved_alike_by_multigrid_and_by_any_number_of_ranks(
    dim: int, folder: Path, comm: MPI.Intracomm
) -> None:
    file = mesh(folder, dim)
    given = rubbed(file, dim, **QUADRATIC)
    solution, alone = solved(given), solve(given, MPI.COMM_SELF)
    assert solution.summary["strain_norm_max"] == pytest.approx(LIMIT, rel=1e-6)
    for name in ("contact_force", "friction_force"):
        assert solution.summary[name] == pytest.approx(alone.summary[name], rel=1e-6, abs=1e-12)
    assert indicated(solution) == pytest.approx(indicated(alone), rel=1e-4)
    other = solved(rubbed(file, dim, solver={"linear": "iterative"}, **QUADRATIC))
    apart = maximum(comm, np.abs(other.displacement.x.array - solution.displacement.x.array))
    assert apart < 1e-6 * solution.summary["displacement_max"]


def test_files_and_pictures_have_the_nodes_and_points_of_the_cells(
    folder: Path, comm: MPI.Intracomm
) -> None:
    solution = solved(rubbed(mesh(folder, 2), 2, **QUADRATIC))
    element = {"degree": 2, "limit_at": "gauss", "cells": "box"}
    assert solution.summary["discretisation"] == element
    found = {one.name: one for one in fields.discontinuous(solution)}
    largest = maximum(comm, found["strain_norm"].x.array)
    # A file has the strain at the nodes, the summary at the points and the corners.
    assert largest >= solution.summary["strain_norm_max_in_cells"] * (1.0 - 1e-9)
    assert set(np.unique(found["locked"].x.array)) <= {0.0, 1.0}
    xdmf.write(solution, folder / "fields.xdmf", comm)
    writing.save(solution, folder / "results")
    if checkpoint.unavailable() is None:
        again = solve_from(solution.parameters, MPI.COMM_SELF, restart=folder / "results")
        assert again.converged and again.summary["iterations"]["tangents"] == 0
    body = gather(solution)
    if body is not None:
        edges = body.x[body.cells[:, 1:]] - body.x[body.cells[:, :1]]
        assert np.abs(np.linalg.det(edges)).sum() / 2.0 == pytest.approx(1.0)
        assert len(body.cells) == 8 * solution.domain.num_cells
        assert len(body.boundary) == 4 * 3 * 2
        assert body.strain_norm.max() <= solution.summary["strain_norm_max_in_cells"]


def rubbed_cube(h: float, **changes: Any) -> Any:
    """A cube in a lattice, clamped at its left, that slides and locks."""
    friction = {"coefficient": 0.05, "smoothing": {"radius": 0.6}}
    lattice = {"mesh__structured": True, "penalty__n": np.inf, "friction": friction}
    return block(3, h, **lattice, **changes)


@pytest.mark.serial
def test_hexahedra_of_degree_two_agree_with_tetrahedra_and_with_finer_cells_of_degree_one() -> None:
    boxes, quadratic = {"mesh__cells": "box"}, {"discretisation__degree": 2}
    found = solved(rubbed_cube(0.5, **boxes, **quadratic))
    gauss = {"discretisation__limit_at": "gauss"}
    others = rubbed_cube(0.25, **quadratic, **gauss), rubbed_cube(0.125, **boxes)
    assert found.summary["slip_area"] > 0.1 and found.summary["limit_used"] > 0.999
    for other in map(solved, others):
        assert found.summary["compliance"] == pytest.approx(other.summary["compliance"], rel=0.03)
        for name, axis, share in (("contact_force", 2, 0.04), ("friction_force", 0, 0.1)):
            wanted = other.summary[name][axis]
            assert found.summary[name][axis] == pytest.approx(wanted, rel=share), name


@pytest.mark.serial
def test_derivatives_on_hexahedra_are_those_of_differences() -> None:
    of = ["compliance", "contact_force.2", "friction_force.0"]
    to = ["material.locking_limit", "friction.coefficient"]
    given = rubbed_cube(
        0.5,
        mesh__cells="box",
        discretisation__degree=2,
        solver={"tolerance": 1e-10, "friction_tolerance": 1e-11},
        sensitivities={"of": of, "to": to, "check": True},
    )
    found = solved(given).summary["sensitivities"]
    for name in of:
        for key in to:
            wanted = found[name][key]["checked"]
            # By a limit the stiffness of the cones multiplies rounding (test_sensitivities.py).
            share = 2e-3 if key == "material.locking_limit" else 1e-3
            assert found[name][key]["derivative"] == pytest.approx(wanted, rel=share), (name, key)


@pytest.mark.slow
def test_hexahedra_lock_with_both_linear_solvers(folder: Path, comm: MPI.Intracomm) -> None:
    loads = {
        "displacements": [{"on": "bottom", "value": [0.0, 0.0, 0.0]}],
        "tractions": [{"on": "top", "value": [0.01, 0.0, -PRESSURE]}],
    }
    changes: dict[str, Any] = {"contact": [], "loads": loads, **QUADRATIC}
    file = mesh(folder, 3)
    direct = solved(pressed(file, 3, **changes))
    assert direct.summary["strain_norm_max"] == pytest.approx(LIMIT, rel=1e-6)
    iterative = solved(pressed(file, 3, solver={"linear": "iterative"}, **changes))
    apart = maximum(comm, np.abs(iterative.displacement.x.array - direct.displacement.x.array))
    assert apart < 1e-5 * direct.summary["displacement_max"]
