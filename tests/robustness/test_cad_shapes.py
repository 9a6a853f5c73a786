"""Tools as from a CAD program press coarse and fine pads with a right force, or with a warning."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cad_shapes import SHAPES
from tool_files import binary_stl

from contact_locking import StudySolution, solve
from contact_locking.study_file import from_mapping

pytestmark = pytest.mark.serial

DEPTH = 0.02
# The share by which the force of a coarse mesh may be off that of a fine mesh: a tool is 0.6 wide,
# and the contact ends half a facet too early or too late on each side.
NEAR = {0.25: 0.5, 0.125: 0.2}
# Shapes with a tip or a ridge, which facets of a multiple of the depth can miss.
SHARP = ("crescent", "wedge", "cone", "pyramid", "plate with teeth", "plate with a needle")
# The other shapes with flat or round sides of the size of the facets of the finer pad.
BLUNT = tuple(set(SHAPES) - {*SHARP, "hemisphere", "frustum"})


def pressed(shape: str, h: float, folder: Path) -> StudySolution:
    """A pad whose nodes are not placed by the tool, which is turned and off the middle."""
    cosine, sine = np.cos(0.3), np.sin(0.3)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    file = folder / "tool.stl"
    file.write_bytes(binary_stl(SHAPES[shape] @ turn.T + [0.51, 0.47, 0.5 - DEPTH]))
    return solve(
        from_mapping(
            {
                "mesh": {
                    "builder": "block",
                    "dim": 3,
                    "size": [1.0, 1.0, 0.5],
                    "h": h,
                    "structured": True,
                },
                "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
                "loads": {"displacements": [{"on": "bottom", "value": [0, 0, 0]}]},
                "contact": {"on": "top", "foundation": {"surface": str(file)}},
                "output": {"picture": False},
            }
        )
    )


def force(solution: StudySolution) -> float:
    return -float(solution.summary["contact_force"][2])


def check(shape: str, sizes: list[float], finest: float, folder: Path) -> None:
    fine = force(pressed(shape, finest, folder))
    for h in sizes:
        solution = pressed(shape, h, folder)
        told = [text for text in solution.summary["warnings"] if "between the nodes" in text]
        assert not any("inside out" in text for text in solution.summary["warnings"])
        assert solution.converged or (told and shape in SHARP), solution.summary["reason"]
        if shape in BLUNT or not told:
            assert force(solution) == pytest.approx(fine, rel=NEAR[h]), h


@pytest.mark.parametrize("shape", ["cross", "cone"])
def test_a_shape_on_a_coarse_pad_has_the_force_or_a_warning(shape: str, tmp_path: Path) -> None:
    check(shape, [0.25], 0.125, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_every_shape_on_every_pad_has_the_force_or_a_warning(shape: str, tmp_path: Path) -> None:
    check(shape, [0.25, 0.125], 0.0625, tmp_path)
