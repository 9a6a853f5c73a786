"""The estimate of memory that `check` prints before anything is solved."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path
from typing import Any

import pytest
from dolfinx import mesh
from mpi4py import MPI
from problems import SMALL_BLOCK, block

from contact_locking import check
from contact_locking.command import cli
from contact_locking.mesh.given_mesh import NamedFacets
from contact_locking.process import forecast
from contact_locking.process.forecast import Estimate
from contact_locking.solver.linear.factorised import chosen


def expected(dim: int, unknowns: int, ranks: int = 1, **changes: Any) -> Estimate:
    """The estimate of the block with so many unknowns."""
    return forecast.estimate(block(dim, 0.5, **changes), dim, unknowns, ranks)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("dim", "unknowns", "ranks", "n", "gigabytes"),
    [
        (2, 8450, 1, math.inf, 0.28),
        (2, 132_098, 1, math.inf, 0.65),
        (3, 14_739, 1, math.inf, 0.40),
        (3, 46_875, 1, math.inf, 0.81),
        (3, 107_811, 2, math.inf, 2.4),
        (3, 206_763, 2, math.inf, 2.8),
        (3, 206_763, 2, 1e4, 2.5),
        (3, 352_947, 2, math.inf, 4.7),
        (3, 352_947, 2, 1e4, 3.8),
        (3, 823_875, 2, math.inf, 11.2),
        (3, 823_875, 2, 1e4, 8.9),
    ],
)
def test_the_estimate_agrees_with_what_was_measured_within_a_factor_of_1_5(
    dim: int, unknowns: int, ranks: int, n: float, gigabytes: float
) -> None:
    found = expected(dim, unknowns, ranks, penalty__n=n)
    assert gigabytes / 1.5 < found.memory / 1e9 < 1.5 * gigabytes


@pytest.mark.serial
@pytest.mark.parametrize(
    ("degree", "cells", "limit", "mu", "gigabytes"),
    [
        (1, (200, 82, 1), math.inf, 0.0, 0.57),
        (1, (200, 82, 1), 2e-5, 0.0, 0.67),
        (1, (200, 82, 1), math.inf, 0.3, 1.0),
        (1, (81, 81, 4), math.inf, 0.0, 0.82),
        (2, (52, 52, 1), math.inf, 0.0, 0.80),
        (2, (30, 30, 4), math.inf, 0.0, 1.14),
    ],
)
def test_the_estimate_of_plates_agrees_with_what_was_measured_within_a_factor_of_1_5(
    degree: int, cells: tuple[int, ...], limit: float, mu: float, gigabytes: float
) -> None:
    unknowns, as_cube = compact(degree, "hexahedron", *cells)
    changes = {"material__locking_limit": limit, "friction__coefficient": mu}
    found = forecast.estimate(block(3, 0.5, **changes), 3, unknowns, 1, as_cube)
    assert gigabytes / 1.5 < found.memory / 1e9 < 1.5 * gigabytes


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
    found = [expected(dim, size, solver__linear=linear) for size in sizes]
    assert all(less.memory < more.memory for less, more in itertools.pairwise(found))
    ranks = [expected(dim, 40_000, ranks, solver__linear=linear).memory for ranks in (1, 2, 8)]
    assert ranks[0] < ranks[1] < ranks[2]


def test_all_ranks_have_one_estimate(comm: MPI.Intracomm) -> None:
    facts = check(block(), comm)
    assert len(set(comm.allgather(facts["estimate"]))) == 1
    assert facts["estimate"].ranks == comm.size
    assert 0.2 < facts["estimate"].memory / comm.size / 1e9 < 0.4


def test_a_solve_that_is_too_large_for_the_machine_is_warned_of(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    parameters = block(friction__smoothing__radius=0.2)
    assert check(parameters, comm)["warnings"] == []
    monkeypatch.setattr(forecast, "memory", lambda: 1e8 if comm.rank == comm.size - 1 else None)
    (warning,) = check(parameters, comm)["warnings"]
    assert "by an estimate, and this machine has 0.1 GB; take a coarser mesh" in warning


@pytest.mark.serial
def test_check_names_the_estimate_an_estimate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "study.yml"
    file.write_text(SMALL_BLOCK)
    words = ["check", str(file), "--set", f"output.directory={tmp_path}/out"]
    assert cli.main(words) == 0
    shown = capsys.readouterr().out
    assert re.search(r"estimated memory +about 0\.\d GB in all, on 1 rank\n", shown)
    assert cli.main([*words, "--set", "adapt={max_dofs: 200000}"]) == 0
    assert capsys.readouterr().out.count("at most about") == 1
    assert Estimate(9e9, 4, "at least").words() == "at least about 9.0 GB in all, on 4 ranks"
    assert expected(3, 10**6).kind == "at least"
