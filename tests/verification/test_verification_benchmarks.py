"""V30: public benchmarks: torsion of a square and a disc, an indented layer, a wavy surface."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from problems import solved, with_changes
from slow import slow
from verification_table import Rows

from contact_locking.results.solution import StudySolution

pytestmark = pytest.mark.serial


def solution_of(data: dict[str, Any]) -> StudySolution:
    found = solved(with_changes(data))
    return found


def _torsion(mesh: dict[str, Any], rim: list[str]) -> StudySolution:
    """``min int |grad w|^2/2 - 5 w`` with ``|grad w| <= 1``, w = 0 on the rim: one layer of cells.

    The displacement is (0, 0, w) and mu = 1, so that ``|eps| = |grad w|/sqrt(2)``.
    """
    loads = {
        "body_force": [0, 0, 5.0],
        "displacements": [
            {"on": ["bottom", "top"], "value": [0, 0, None]},
            {"on": rim, "value": [0, 0, 0]},
        ],
    }
    material = {"elasticity": {"lambda": 0.0, "mu": 1.0}, "locking_limit": 1 / math.sqrt(2)}
    return solution_of({"mesh": mesh, "material": material, "loads": loads, "contact": []})


def _least_energy(solution: StudySolution, thickness: float) -> float:
    summary = solution.summary
    return float((summary["elastic_energy"] - summary["compliance"]) / thickness)


@pytest.mark.parametrize(("cells", "rest"), [("simplex", 0.02), ("box", 0.005)])
def test_v30_torsion_of_a_square_has_the_optimum_of_cops_15(
    cells: str, rest: float, found: Rows
) -> None:
    """Dolan, More and Munson, COPS (ANL/MCS-TM-273), problem 15 with c = 5."""
    h, optimum = 1 / 20, -4.18087e-1
    mesh = {"builder": "block", "dim": 3, "size": [1, 1, h], "h": h, "structured": True}
    energy = _least_energy(
        _torsion({**mesh, "cells": cells}, ["left", "right", "front", "back"]), h
    )
    problem = f"COPS 15, torsion of a square{', hexahedra' if cells == 'box' else ''}"
    found.add("V30", problem, "least energy", energy, optimum, rel=rest)
    assert cells == "box" or energy > optimum


def _disc(path: Path, thickness: float, h: float, boxes: bool) -> None:
    """A disc of radius 1 and one layer of cells."""
    import gmsh

    gmsh.initialize([], interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        disc = gmsh.model.occ.addDisk(0, 0, 0, 1, 1)
        body = gmsh.model.occ.extrude(
            [(2, disc)], 0, 0, thickness, numElements=[1], recombine=boxes
        )
        gmsh.model.occ.synchronize()
        top, side = body[0][1], body[2][1]
        gmsh.model.addPhysicalGroup(3, [body[1][1]], name="body")
        for name, tag in (("bottom", disc), ("top", top), ("side", side)):
            gmsh.model.addPhysicalGroup(2, [tag], name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", h)
        gmsh.option.setNumber("Mesh.RecombineAll", int(boxes))
        gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3 if boxes else 1)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("boxes", [False, True], ids=["simplices", "boxes"])
def test_v30_torsion_of_a_disc_is_a_cone_outside_of_its_middle(
    boxes: bool, tmp_path: Path, found: Rows
) -> None:
    """``w = 1 - r`` for r >= 2/c and a parabola inside: w(0) = 1 - 1/c (Glowinski, 2008, c = 5).

    Numerical Methods for Nonlinear Variational Problems, doi:10.1007/978-3-540-77801-1.
    """
    h, file = 0.06, tmp_path / "disc.msh"
    _disc(file, h, h, boxes)
    solution = _torsion({"file": str(file)}, ["side"])
    top = float(np.max(solution.displacement.x.array))
    energy = _least_energy(solution, h)
    problem = f"torsion of a disc{', hexahedra' if boxes else ''}"
    found.add("V30", problem, "largest displacement", top, 0.8, rel=0.01)
    found.add("V30", problem, "least energy", energy, -3.7071, rel=0.02)


def test_v30_a_wavy_surface_touches_as_far_as_westergaard_says(found: Rows) -> None:
    """``p_mean = p* sin^2(pi a/lambda)``, ``p* = pi E* D/lambda``: half of p* for a = lambda/4.

    Johnson, Contact Mechanics (1985), section 13.2 (doi:10.1017/CBO9781139171731).
    """
    amplitude, young, poisson = 1e-3, 1.0, 0.3
    full = math.pi * young / (1 - poisson**2) * amplitude
    solution = solution_of(
        {
            "mesh": {"builder": "block", "size": [0.5, 1.0], "h": 1 / 64, "structured": True},
            "material": {"elasticity": {"young": young, "poisson": poisson}},
            "loads": {
                "tractions": [{"on": "top", "value": [0, -0.5 * full]}],
                "displacements": [{"on": ["left", "right"], "value": [0, None]}],
            },
            "discretisation": {"degree": 2},
            "contact": {"on": "bottom", "gap": f"{amplitude}*(1 - cos(2*pi*x))"},
        }
    )
    assert solution.contact_points is not None
    width = solution.summary["contact_area"]
    peak = float(np.max(solution.contact_points.pressure)) / full
    problem = "Westergaard's wave, mean pressure p*/2"
    found.add("V30", problem, "half-width over the length", width, 0.25, abs=1 / 64)
    found.add("V30", problem, "peak over p*", peak, math.sqrt(2.0), rel=0.01)


@pytest.mark.parametrize(
    ("poisson", "factor"),
    [slow(0.30, 2.480), slow(0.35, 2.603), slow(0.40, 2.789), (0.45, 3.085), slow(0.4999, 3.609)],
)
def test_v30_a_flat_punch_indents_a_bonded_layer_with_the_force_of_hayes(
    poisson: float, factor: float, found: Rows
) -> None:
    """``F = 4 a kappa G w/(1 - nu)`` for a punch as wide as the layer is thick.

    Hayes and others, J. Biomech. 5 (1972) 541 (doi:10.1016/0021-9290(72)90010-3), a/h = 1.  The
    last factor is that of nu = 0.5, which a displacement alone does not reach: from 0.4999 to 0.5
    it grows by 0.03 %.
    """
    depth, shear = 0.001, 0.5 / (1.0 + poisson)
    h = 1 / 20
    solution = solution_of(
        {
            "mesh": {
                "builder": "block",
                "size": [6.0, 1.0],
                "h": h,
                "structured": True,
                "axisymmetric": True,
            },
            "material": {"elasticity": {"young": 1.0, "poisson": poisson}},
            "discretisation": {"degree": 2},
            "loads": {"displacements": [{"on": "bottom", "value": [0, 0]}]},
            "contact": {"on": "top", "gap": f"-{depth} if x < 1.0001 else 1"},
        }
    )
    force = -solution.summary["contact_force"][1]
    kappa = force * (1.0 - poisson) / (4.0 * shear * depth)
    problem = f"Hayes' layer, nu = {poisson:g}"
    found.add("V30", problem, "kappa", kappa, factor, rel=0.02)
