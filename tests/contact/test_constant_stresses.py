"""Constant stresses cross the interfaces of bodies that touch each other: patch tests."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import solved
from two_bodies import POISSON, YOUNG, bent_boxes, stack

from contact_locking import assemble
from contact_locking.problem.system import BodyForms
from contact_locking.study_file.parameters import Parameters

pytest.importorskip("gmsh")

COMM = MPI.COMM_WORLD


def facing(swapped: bool) -> dict[str, str]:
    sides = ["lower_top", "upper_bottom"]
    return {"on": sides[not swapped], "against": sides[swapped]}


def largest(values: Any) -> float:
    return float(COMM.allreduce(np.abs(values).max(initial=0.0), op=MPI.MAX))


def grids(cells: str, dim: int) -> dict[str, Any]:
    """Gmsh makes hexahedra for grids alone."""
    return {"mesh__cells": cells, "mesh__structured": cells == "box" and dim == 3}


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(("cells", "degree"), [("simplex", 1), ("simplex", 2), ("box", 1)])
def test_constant_stresses_cross_unmatched_and_tilted_interfaces(
    dim: int, swapped: bool, cells: str, degree: int
) -> None:
    given = stack(
        dim,
        0.25 if dim == 2 else 0.4,
        mesh__slope=0.2,
        contact=facing(swapped),
        discretisation__degree=degree,
        friction__coefficient=1.0,
        **grids(cells, dim),
    )
    jump, force, area = at_constant_stress(given)
    assert jump <= 1e-12 and force <= 1e-12
    assert area == pytest.approx(math.hypot(1.0, 0.2), rel=1e-12)


@pytest.mark.parametrize("swapped", [False, True])
def test_constant_stresses_cross_quadrilaterals_that_are_no_parallelograms(
    swapped: bool, tmp_path: Path
) -> None:
    mesh = {"file": str(bent_boxes(COMM, tmp_path, (3, 4), 0.2))}
    given = stack(3, mesh=mesh, contact=facing(swapped), friction__coefficient=1.0)
    jump, force, area = at_constant_stress(given)
    # Of stresses of size 20.
    assert jump <= 1e-12 and force <= 1e-11
    assert area == pytest.approx(math.hypot(1.0, 0.2), rel=1e-12)


def at_constant_stress(given: Parameters) -> tuple[float, float, float]:
    """The largest jump, and force inside of the blocks, of an affine field, and the area of side 1.

    At the outer boundary are reactions.
    """
    problem = assemble(given, COMM)
    (contact,), dim, u = problem.contacts, problem.domain.dim, problem.u
    gradient = np.arange(1.0, dim * dim + 1.0).reshape(dim, dim)
    u.interpolate(lambda x: gradient @ x[:dim])
    stress = elastic_stress(0.5 * (gradient + gradient.T))
    forces = BodyForms(u.function_space, problem.data).elastic_forces(u)
    forces -= contact.surface.nodal_forces(contact.normals @ stress)
    x = u.function_space.tabulate_dof_coordinates()[:, :dim]
    ends = np.array([1.0] * (dim - 1) + [2.0])
    inside = np.all((x > 1e-9) & (x < ends - 1e-9), axis=1)
    jump = largest(contact.surface.operator.values(u.x.array))
    area = float(COMM.allreduce(contact.surface.weights.sum()))
    return jump, largest(forces.reshape(-1, dim)[inside]), area


def elastic_stress(strain: Any) -> Any:
    shear = YOUNG / (2.0 * (1.0 + POISSON))
    lame = YOUNG * POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON))
    return lame * np.trace(strain) * np.eye(len(strain)) + 2.0 * shear * strain


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_cylinders_carry_a_uniform_pressure_along_their_axis(degree: int, slope: float) -> None:
    """Also where they meet on a cone; the lower face widens as it wants to."""
    widening = POISSON / YOUNG * 0.01
    solution = solved(
        stack(
            2,
            0.25,
            mesh__axisymmetric=True,
            mesh__slope=slope,
            loads__displacements=[{"on": "bottom", "value": [f"{widening}*x", 0.0]}],
            friction__coefficient=1.0,
            discretisation={"degree": degree},
            solver__tolerance=1e-8,
        )
    )
    exact = np.diag([0.0, -0.01, 0.0])
    stress = solution.elastic_stress.x.array.reshape(-1, 3, 3)
    assert largest(stress - exact) <= 1e-8
    # On the disc of radius 1.
    (contact,) = solution.summary["contacts"]
    force = contact["contact_force"][1] + contact["friction_force"][1]
    assert force == pytest.approx(0.01 * math.pi, rel=1e-7)
