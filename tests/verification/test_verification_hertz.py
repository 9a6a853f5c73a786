"""V4: a parabolic indenter on a block against half-space theory; data of the comet-fenics demo."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boxes import write_lattice
from problems import solved, with_changes
from scipy import optimize
from verification_table import Rows

pytestmark = pytest.mark.serial

RADIUS, DEPTH, YOUNG, POISSON = 0.5, 0.02, 10.0, 0.3
HALF_WIDTH = math.sqrt(RADIUS * DEPTH)
MODULUS = YOUNG / (1.0 - POISSON**2)
FORCE = 4.0 / 3.0 * MODULUS * HALF_WIDTH * DEPTH
PEAK = 1.5 * FORCE / (math.pi * HALF_WIDTH**2)


def section(path: Path, size: float, h: float, finest: float, dim: int = 3) -> None:
    """A quarter of the block, in 2D the half section of a cylinder, fine around the origin."""
    import gmsh

    gmsh.initialize([], interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        if dim == 3:
            body = gmsh.model.occ.addBox(0, 0, 0, size, size, size)
            sides = [("bottom", 2, 0.0), ("top", 2, size), ("left", 0, 0.0), ("front", 1, 0.0)]
        else:
            body = gmsh.model.occ.addRectangle(0, 0, 0, size, size)
            sides = [("bottom", 1, 0.0), ("top", 1, size)]
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(dim, [body], name="body")
        for name, axis, place in sides:
            tags = [
                tag
                for _, tag in gmsh.model.getEntities(dim - 1)
                if abs(gmsh.model.occ.getCenterOfMass(dim - 1, tag)[axis] - place) < 1e-9
            ]
            gmsh.model.addPhysicalGroup(dim - 1, tags, name=name)
        ball = gmsh.model.mesh.field.add("Ball")
        sizes = {"Radius": 1.3 * HALF_WIDTH, "Thickness": size, "VIn": finest, "VOut": h}
        for key, value in sizes.items():
            gmsh.model.mesh.field.setNumber(ball, key, value)
        gmsh.model.mesh.field.setAsBackgroundMesh(ball)
        for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        gmsh.model.mesh.generate(dim)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def lattice(path: Path, size: float, finest: float, cells: int) -> None:
    """The same quarter of hexahedra, whose edges grow from the origin in a geometric sequence."""
    growth = optimize.brentq(lambda q: finest * (q**cells - 1.0) / (q - 1.0) - size, 1.01, 3.0)
    line = np.r_[0.0, np.cumsum(finest * growth ** np.arange(cells))]
    write_lattice(path, (cells,) * 3, lambda x: line[np.rint(x * cells).astype(int)])


def indented(
    folder: Path, size: float, h: float, finest: float, degree: int = 1
) -> tuple[float, float, float]:
    """Force, half-width and peak pressure on the whole block."""
    file = folder / "quarter.msh"
    section(file, size, h, finest)
    return indented_by(file, degree)


def indented_by(file: Path, degree: int = 1) -> tuple[float, float, float]:
    """The same of a quarter in a file."""
    data: dict[str, Any] = {
        "mesh": {"file": str(file)},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {
            "displacements": [
                {"on": "left", "value": [0, None, None]},
                {"on": "front", "value": [None, 0, None]},
                {"on": "top", "value": [0, 0, 0]},
            ]
        },
        "contact": {"on": "bottom", "gap": f"(x*x + y*y)/(2*{RADIUS}) - {DEPTH}"},
        "penalty": {"n": 1e4, "epsilon": 1e-4},
        "discretisation": {"degree": degree},
    }
    solution = solved(with_changes(data))
    assert solution.contact_points is not None
    area = 4.0 * solution.summary["contact_area"]
    return (
        4.0 * solution.summary["contact_force"][2],
        math.sqrt(area / math.pi),
        float(solution.contact_points.pressure.max()),
    )


def record(found: Rows, where: str, values: tuple[float, float, float]) -> None:
    for name, value, exact in zip(
        ("force", "half-width", "peak pressure"), values, (FORCE, HALF_WIDTH, PEAK), strict=True
    ):
        found.add("V4", where, name, value, exact)


def test_v4_the_unit_block_is_somewhat_stiffer_than_a_half_space(
    tmp_path: Path, found: Rows
) -> None:
    values = indented(tmp_path, 1.0, 0.2, 0.016)
    record(found, "indented unit block", values)
    force, half_width, peak = values
    # The block is ten half-widths high on a fixed base.
    assert FORCE < force < 1.13 * FORCE
    assert half_width == pytest.approx(HALF_WIDTH, rel=0.06)
    assert peak == pytest.approx(PEAK, rel=0.08)


@pytest.mark.slow
def test_v4_hexahedra_that_grow_away_from_the_indenter(tmp_path: Path, found: Rows) -> None:
    """A block of 20 half-widths with 4913 nodes; five facets are as long as the half-width."""
    lattice(tmp_path / "quarter.xdmf", 2.0, 0.02, 16)
    force, half_width, peak = indented_by(tmp_path / "quarter.xdmf")
    record(found, "indented block of size 2, hexahedra", (force, half_width, peak))
    assert force == pytest.approx(FORCE, rel=0.04)
    assert half_width == pytest.approx(HALF_WIDTH, rel=0.1)
    assert peak == pytest.approx(PEAK, rel=0.03)


@pytest.mark.slow
def test_v4_a_larger_block_is_nearer_to_the_half_space(tmp_path: Path, found: Rows) -> None:
    values = indented(tmp_path, 4.0, 0.5, 0.008)
    record(found, "indented block of size 4", values)
    for value, exact in zip(values, (FORCE, HALF_WIDTH, PEAK), strict=True):
        assert value == pytest.approx(exact, rel=0.05)
