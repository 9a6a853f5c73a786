"""V31-V36: press fits and strains that are not elastic, with closed forms.

A ring a < r < b in plane stress that a rigid shaft opens by d has Lame's pressure
``p = E d/a/((b^2 + a^2)/(b^2 - a^2) + nu)``; plane strain has ``E/(1 - nu^2)`` and ``nu/(1 - nu)``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import with_changes
from verification_table import Rows

from contact_locking import solve
from contact_locking.laws.body import lame_from_young
from contact_locking.parallel import maximum
from contact_locking.results.solution import StudySolution

pytestmark = pytest.mark.serial

INNER, OUTER, YOUNG, POISSON, OVERLAP = 1.0, 2.0, 1.0, 0.3, 0.01


def lame_pressure(plane: str, opened: float) -> float:
    strain = plane == "strain"
    young = YOUNG / (1.0 - POISSON**2) if strain else YOUNG
    poisson = POISSON / (1.0 - POISSON) if strain else POISSON
    shape = (OUTER**2 + INNER**2) / (OUTER**2 - INNER**2)
    return young * opened / INNER / (shape + poisson)


def solved(data: dict[str, Any], comm: MPI.Intracomm, **changes: Any) -> StudySolution:
    found = solve(with_changes(data, **changes), comm)
    assert found.converged, found.summary["reason"]
    return found


def ring(plane: str, degree: int, **changes: Any) -> dict[str, Any]:
    """A quarter of a ring on a rigid shaft, without friction."""
    held = [{"on": "left", "value": [0, None]}, {"on": "bottom", "value": [None, 0]}]
    radii = {"inner_radius": INNER, "outer_radius": OUTER}
    return {
        "mesh": {"builder": "annulus", "quarter": True, "h": 0.1, **radii},
        "discretisation": {"degree": degree},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}, "plane": plane},
        "loads": {"displacements": held},
        "contact": {"on": "inner"},
        "friction": {"coefficient": 0.0},
        "penalty": {"n": math.inf},
    } | changes


def mean_pressure(found: StudySolution) -> float:
    """The mean pressure on the quarter circle, from its resultant ``p a`` along each axis."""
    return float(np.mean(np.abs(found.summary["contact_force"]))) / INNER


@pytest.mark.parametrize(("plane", "degree"), [("stress", 1), ("stress", 2), ("strain", 1)])
def test_v31_a_ring_pressed_on_a_shaft_has_lames_pressure(
    plane: str, degree: int, found: Rows, comm: MPI.Intracomm
) -> None:
    fit = ring(plane, degree, contact={"on": "inner", "gap": -OVERLAP})
    pressure, exact = mean_pressure(solved(fit, comm)), lame_pressure(plane, OVERLAP)
    where = f"press fit, plane {plane}, degree {degree}, h = 0.1"
    # The chords of the mesh are inside of the circle by h^2/8.
    found.add("V31", where, "mean pressure", pressure, exact, rel=6e-3 if degree == 1 else 2e-3)


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_v32_a_ring_that_cools_shrinks_onto_its_shaft(
    plane: str, found: Rows, comm: MPI.Intracomm
) -> None:
    cold = {"expansion": 1.2e-5, "temperature": -800.0}
    fit = ring(plane, 1)
    fit["material"]["eigenstrain"] = cold
    opened = 1.2e-5 * 800.0 * INNER * (1.0 + POISSON if plane == "strain" else 1.0)
    pressure, exact = mean_pressure(solved(fit, comm)), lame_pressure(plane, opened)
    where = f"shrink fit, plane {plane}, h = 0.1"
    found.add("V32", where, "mean pressure", pressure, exact, rel=6e-3)


def test_v33_a_bimetal_strip_has_timoshenkos_curvature(found: Rows, comm: MPI.Intracomm) -> None:
    """Two layers of one stiffness and thickness h/2: the curvature is ``3/2 (e_1 - e_2)/h``.

    Timoshenko (1925), doi:10.1364/JOSA.11.000233.  Weak springs hold the height of the middle of
    the strip, where nothing acts across.
    """
    length, apart = 10.0, 1e-3
    strip = {
        # The corners of cells are where the strain jumps, and the Gauss points of boxes are not.
        "mesh": {
            **{"builder": "block", "size": [length, 1.0], "h": 0.0625},
            **{"structured": True, "cells": "box"},
        },
        "material": {
            "elasticity": {"young": YOUNG, "poisson": POISSON},
            "plane": "stress",
            "eigenstrain": {"value": f"0 if y > 0.5 else {apart}"},
        },
        "loads": {
            "displacements": [{"on": "left", "value": [0.0, None]}],
            "springs": [{"on": "left", "stiffness": 1e-4, "along": [0, 1]}],
        },
        "contact": {"on": []},
    }
    solution = solved(strip, comm)
    x = solution.displacement.function_space.tabulate_dof_coordinates()
    u = solution.displacement.x.array.reshape(-1, 2)
    top = np.abs(x[:, 1] - 1.0) < 1e-9
    # Away from the end, where the layers are stressed alike along the strip.
    left = u[top & (np.abs(x[:, 0] - 2.0) < 1e-9), 1]
    middle = u[top & (np.abs(x[:, 0] - 4.0) < 1e-9), 1]
    right = u[top & (np.abs(x[:, 0] - 6.0) < 1e-9), 1]
    ends = [maximum(comm, part, -np.inf) for part in (left, middle, right)]
    curvature = (ends[0] - 2.0 * ends[1] + ends[2]) / 2.0**2
    exact = 1.5 * apart
    found.add("V33", "bimetal strip, quadrilaterals", "curvature", curvature, exact, rel=1e-2)


def block(held: list[dict[str, Any]], **material: Any) -> dict[str, Any]:
    return {
        "mesh": {"builder": "block", "dim": 3, "size": [2.0, 1.0, 1.0], "h": 0.5},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}} | material,
        "loads": {"displacements": held},
        "contact": {"on": []},
        "penalty": {"n": math.inf},
    }


ROLLERS = [
    {"on": "left", "value": [0.0, None, None]},
    {"on": "front", "value": [None, 0.0, None]},
    {"on": "bottom", "value": [None, None, 0.0]},
]
HEAT = {"expansion": 1.2e-5, "temperature": 500.0}
STRAIN = 1.2e-5 * 500.0


def test_v34_free_expansion_has_no_stress(found: Rows, comm: MPI.Intracomm) -> None:
    solution = solved(block(ROLLERS, eigenstrain=HEAT), comm)
    stress = solution.summary["von_mises_max"]
    moved = solution.summary["displacement_max"]
    exact = STRAIN * math.sqrt(6.0)
    found.add("V34", "free expansion, 3D", "largest stress", stress, 0.0)
    found.add("V34", "free expansion, 3D", "largest displacement", moved, exact, rel=1e-9)
    assert stress < 1e-10


def test_v35_a_clamped_bar_under_heat_has_the_stress_e_alpha_t(
    found: Rows, comm: MPI.Intracomm
) -> None:
    held = [*ROLLERS, {"on": "right", "value": [0.0, None, None]}]
    solution = solved(block(held, eigenstrain=HEAT), comm)
    stress, exact = -solution.summary["reactions"]["right"][0], YOUNG * STRAIN
    found.add("V35", "clamped bar under heat, 3D", "pressure", stress, exact, rel=1e-8)
    energy = 0.5 * YOUNG * STRAIN**2 * 2.0
    assert solution.summary["elastic_energy"] == pytest.approx(energy, rel=1e-8)


def test_v36_heat_locks_the_body(found: Rows, comm: MPI.Intracomm) -> None:
    """``eps = M I/sqrt(3)``, and ``|Z| = sqrt(3) (3 lambda + 2 mu) (e - M/sqrt(3))``."""
    limit = 0.6 * STRAIN * math.sqrt(3.0)
    solution = solved(block(ROLLERS, eigenstrain=HEAT, locking_limit=limit), comm)
    lame_lambda, lame_mu = lame_from_young(YOUNG, POISSON)
    exact = math.sqrt(3.0) * (3.0 * lame_lambda + 2.0 * lame_mu) * 0.4 * STRAIN
    values = solution.locking_stress.x.array.reshape(-1, 9)
    locking = maximum(comm, np.linalg.norm(values, axis=1))
    strain = solution.summary["strain_norm_max"]
    found.add("V36", "locking by heat, 3D", "strain", strain, limit, rel=1e-7)
    found.add("V36", "locking by heat, 3D", "locking stress", locking, exact, rel=1e-5)
