"""Quadratic displacements, with limits at the vertices of each cell."""

from __future__ import annotations

import dataclasses

import basix
import numpy as np
import pytest
import ufl
from certified import work_of_stored_forces
from manufactured import Manufactured
from mpi4py import MPI
from problems import block, solved
from quadratic_bodies import cube, quadratic, solved_cube, square
from test_elements import LIMIT
from test_verification_manufactured import problem_of

from contact_locking.fem.spaces import P2, gauss_element, gauss_shares
from contact_locking.mesh.data import NAMED


@pytest.mark.serial
@pytest.mark.parametrize("cell", NAMED)
def test_gauss_points_are_numbered_as_the_corners_and_integrate_quadratics(cell: str) -> None:
    kind, shares = NAMED[cell], gauss_shares(cell)
    count, dim = kind.corners, kind.dim
    assert np.array_equal(np.argmax(shares, axis=1), np.arange(count))
    assert shares.sum(axis=1) == pytest.approx(np.ones(count))
    if kind.is_simplex:
        # int lambda_i lambda_j over a simplex of volume 1.
        wanted = (1.0 + np.eye(count)) / ((dim + 1) * (dim + 2))
    else:
        # int phi_i phi_j over a box of volume 1: 1/3 for each equal coordinate, 1/6 for others.
        apart = np.abs(kind.places[:, None] - kind.places).sum(axis=2)
        wanted = 0.5**apart / 3.0**dim
    assert shares.T @ shares / count == pytest.approx(wanted)
    element = gauss_element(cell)
    points, _ = basix.make_quadrature(basix.CellType[cell], 2)
    values = element.tabulate(0, points)[0]
    assert np.sort(values.reshape(count, count), axis=1)[:, -1] == pytest.approx(1.0)
    assert np.abs(values).sum() == pytest.approx(float(count))


def test_limits_at_vertices_hold_in_the_cells() -> None:
    summary = square().summary
    assert summary["discretisation"] == {"degree": 2}
    assert summary["strain_norm_max_in_cells"] == summary["strain_norm_max"]
    assert summary["overstrain_max"] <= 1e-9


@pytest.mark.serial
def test_the_overstrain_is_relative_to_the_limit_at_the_vertex(comm: MPI.Intracomm) -> None:
    # The strain of u = (x y, 0)/100 at the corner (1, 1) is the largest, and there M is 1.
    exact = ["0.01*x*y", "0"]
    loads = {
        "displacements": [{"on": ["left", "right", "top", "bottom"], "value": exact}],
        "body_force": ["0", "-0.008"],
    }
    material = {"elasticity": {"young": 1.0, "poisson": 0.25}, "locking_limit": "0.02 + 0.98*x"}
    mesh = {"h": 0.5, "structured": True, "cells": "box"}
    summary = solved(
        block(2, contact__on=[], loads=loads, material=material, mesh=mesh), comm
    ).summary
    assert summary["strain_norm_max_in_cells"] == pytest.approx(0.01 * np.sqrt(1.5), rel=1e-9)
    assert summary["overstrain_max"] == 0.0


@pytest.mark.serial
@pytest.mark.parametrize("n", [1e3, np.inf])
def test_the_stored_stresses_and_forces_do_the_work_of_the_loads(
    n: float, comm: MPI.Intracomm
) -> None:
    solution = square() if np.isinf(n) else solved(quadratic(4, penalty__n=n), comm)
    dx = solution.element.locking_dx(ufl.Measure("dx", domain=solution.domain.mesh))
    work = work_of_stored_forces(solution, dx)
    assert work == pytest.approx(solution.summary["compliance"], rel=1e-8)


@pytest.mark.serial
def test_a_stiffness_that_jumps_within_cells_stays_elliptic(comm: MPI.Intracomm) -> None:
    # Through the values 1 and 1000 an affine function is negative beyond the points.
    elasticity = {"young": "1000 if x < 0.45 else 1", "poisson": 0.3}
    material = {"elasticity": elasticity, "locking_limit": LIMIT}
    solved(quadratic(3, material=material), comm)


@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="compares with one rank")
def test_results_do_not_depend_on_the_number_of_ranks() -> None:
    for parameters, together in ((quadratic(4), square()), (cube(), solved_cube())):
        alone = solved(parameters, MPI.COMM_SELF)
        for key in ("compliance", "strain_norm_max_in_cells", "locked_fraction", "contact_area"):
            assert together.summary[key] == pytest.approx(alone.summary[key], rel=1e-8), key
        errors = [s.summary["certificate"]["errors"]["mesh"] for s in (alone, together)]
        assert errors[1] == pytest.approx(errors[0], rel=1e-6)
        if together.contact_points is not None:
            assert alone.contact_points is not None
            for name in ("x", "pressure", "u_normal", "bound"):
                found, wanted = (getattr(s.contact_points, name) for s in (together, alone))
                assert found == pytest.approx(wanted, rel=1e-6, abs=1e-9), name


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
def test_the_indicator_vanishes_for_a_quadratic_solution(dim: int, comm: MPI.Intracomm) -> None:
    sides = ["left", "right", "top", "bottom", *(["front", "back"] if dim == 3 else [])]
    exact = ["0.01*x*x", "0.01*x*y", *(["0"] if dim == 3 else [])]
    # lambda = mu = 0.4.
    loads = {
        "displacements": [{"on": sides, "value": exact}],
        "body_force": ["-0.032", *["0"] * (dim - 1)],
    }
    elasticity = {"young": 1.0, "poisson": 0.25}
    material = {"elasticity": elasticity, "locking_limit": float("inf")}
    changes = {"contact__on": [], "loads": loads, "material": material}
    solution = solved(block(dim, 0.5, discretisation__degree=2, **changes), comm)
    assert solution.error_indicator is not None
    # At a corner with one cell the polynomial of the patch is affine.
    relative = solution.summary["certificate"]["errors"]["mesh"]["relative"]
    assert relative <= 1e-3


@pytest.mark.serial
def test_the_indicator_is_near_the_error_of_a_smooth_solution() -> None:
    given: Manufactured = dataclasses.replace(problem_of("all together"), element=P2)
    solution = given.solved(1 / 8)
    errors, estimate = given.errors(solution), solution.summary["certificate"]["errors"]["mesh"]
    assert estimate["energy_norm"] / errors.energy == pytest.approx(1.0, abs=0.1)
    assert estimate["with_locking"] / errors.with_locking == pytest.approx(1.0, abs=0.1)
