"""The sizes that are factorised, and the estimate of memory that `check` prints."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path

import pytest
from dolfinx import mesh
from mpi4py import MPI
from problems import SMALL_BLOCK

from contact_locking.command import cli
from contact_locking.mesh.given_mesh import NamedFacets
from contact_locking.solver.linear.factorised import chosen, estimated_memory


@pytest.mark.serial
@pytest.mark.parametrize(
    ("dim", "unknowns", "ranks", "gigabytes"),
    [
        (2, 8450, 1, 0.28),
        (2, 132_098, 1, 0.65),
        (3, 14_739, 1, 0.40),
        (3, 46_875, 1, 0.81),
        (3, 107_811, 2, 2.4),
        (3, 206_763, 2, 2.8),
        (3, 352_947, 2, 4.7),
        (3, 823_875, 2, 11.2),
    ],
)
def test_the_estimate_agrees_with_what_was_measured_within_a_factor_of_1_5(
    dim: int, unknowns: int, ranks: int, gigabytes: float
) -> None:
    found = estimated_memory("auto", dim, unknowns, unknowns, ranks) / 1e9
    assert gigabytes / 1.5 < found < 1.5 * gigabytes


@pytest.mark.serial
@pytest.mark.parametrize(
    ("degree", "cells", "gigabytes"),
    [
        (1, (200, 82, 1), 0.57),
        (1, (200, 82, 1), 1.0),
        (1, (81, 81, 4), 0.82),
        (2, (52, 52, 1), 0.80),
        (2, (30, 30, 4), 1.14),
    ],
)
def test_the_estimate_of_plates_agrees_with_what_was_measured_within_a_factor_of_1_5(
    degree: int, cells: tuple[int, ...], gigabytes: float
) -> None:
    found = estimated_memory("auto", 3, *compact(degree, "hexahedron", *cells), 1) / 1e9
    assert gigabytes / 1.5 < found < 1.5 * gigabytes


def compact(degree: int, kind: str, *cells: int) -> tuple[int, int]:
    """The unknowns of a grid, and those of the cube that takes as long to factorise."""
    corners = [[0.0, 0.0, 0.0], [200.0, 100.0, 1.0]]
    grid = mesh.create_box(MPI.COMM_WORLD, corners, cells, getattr(mesh.CellType, kind))
    unknowns = 3 * math.prod(degree * count + 1 for count in cells)
    return unknowns, NamedFacets(grid).domain().compact_size(unknowns, degree)


@pytest.mark.parametrize("kind", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_a_cube_counts_by_its_unknowns_and_a_plate_by_its_separator(degree: int, kind: str) -> None:
    cube, as_cube = compact(degree, kind, 8, 8, 8)
    assert as_cube == cube
    _, as_plate = compact(degree, kind, 20, 20, 3)
    separator = (20 * degree + 1) * (3 * degree + 1)
    assert as_plate == pytest.approx(3 * separator**1.5, rel=1e-3)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("degree", "cells"),
    [
        (1, (128, 128, 1)),
        (1, (200, 82, 1)),
        (1, (105, 105, 2)),
        (1, (91, 91, 3)),
        (1, (81, 81, 4)),
        (1, (200, 32, 4)),
        (2, (52, 52, 1)),
        (2, (40, 40, 2)),
        (2, (35, 35, 3)),
        (2, (30, 30, 4)),
        (2, (100, 9, 4)),
    ],
)
def test_plates_of_100_000_unknowns_are_factorised_by_default(
    degree: int, cells: tuple[int, ...]
) -> None:
    unknowns, as_cube = compact(degree, "hexahedron", *cells)
    assert unknowns > 95_000
    assert chosen("auto", 3, as_cube) == "direct"


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("linear", ["direct", "iterative"])
def test_more_unknowns_and_more_ranks_take_more_memory(dim: int, linear: str) -> None:
    sizes = [round(10 ** (k / 4)) for k in range(8, 33)]
    found = [estimated_memory(linear, dim, size, size, 1) for size in sizes]
    assert all(less < more for less, more in itertools.pairwise(found))
    one, two, eight = (estimated_memory(linear, dim, 40_000, 40_000, k) for k in (1, 2, 8))
    assert one < two < eight


@pytest.mark.serial
def test_check_names_the_estimate_an_estimate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "study.yml"
    file.write_text(SMALL_BLOCK)
    words = ["check", str(file), "--set", f"output.directory={tmp_path}/out"]
    assert cli.main(words) == 0
    shown = capsys.readouterr().out
    assert re.search(r"estimated memory +about 0\.\d GB on 1 rank\n", shown)
    assert cli.main([*words, "--set", "adapt={max_dofs: 200000}"]) == 0
    assert capsys.readouterr().out.count("at most about") == 1
