"""The estimate of memory and time that `check` prints before anything is solved."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI
from problems import SMALL_BLOCK, block

from contact_locking import assemble, check
from contact_locking.command import cli
from contact_locking.costs import forecast, probe
from contact_locking.costs.forecast import Estimate, estimate, workload


def expected(dim: int, unknowns: int, ranks: int = 1, **changes: Any) -> Estimate:
    """The estimate of the block with so many unknowns on the machine of the reference."""
    return estimate(workload(block(dim, 0.5, **changes), dim, unknowns, ranks))


@pytest.mark.serial
@pytest.mark.parametrize(
    ("dim", "unknowns", "ranks", "n", "seconds", "gigabytes"),
    [
        (2, 8450, 1, math.inf, 1.3, 0.28),
        (2, 132_098, 1, math.inf, 12.5, 0.65),
        (3, 14_739, 1, math.inf, 5.0, 0.40),
        (3, 46_875, 1, math.inf, 26.0, 0.81),
        (3, 107_811, 2, math.inf, 32.0, 2.4),
        (3, 206_763, 2, math.inf, 66.0, 2.8),
        (3, 206_763, 2, 1e4, 70.0, 2.5),
        (3, 352_947, 2, math.inf, 137.0, 4.7),
        (3, 352_947, 2, 1e4, 114.0, 3.8),
        (3, 823_875, 2, math.inf, 455.0, 11.2),
        (3, 823_875, 2, 1e4, 312.0, 8.9),
    ],
)
def test_the_estimate_agrees_with_what_was_measured_within_a_factor_of_1_5(
    dim: int, unknowns: int, ranks: int, n: float, seconds: float, gigabytes: float
) -> None:
    found = expected(dim, unknowns, ranks, penalty__n=n)
    assert seconds / 1.5 < found.seconds < 1.5 * seconds
    assert gigabytes / 1.5 < found.memory / 1e9 < 1.5 * gigabytes


@pytest.mark.parametrize("degree", [1, 2])
def test_a_cube_counts_by_its_unknowns_and_a_plate_by_its_separators(degree: int) -> None:
    def sizes(*size: float) -> tuple[int, int]:
        mesh = {"builder": "block", "dim": 3, "size": list(size), "h": 1.0, "structured": True}
        problem = assemble(block(3, mesh=mesh), MPI.COMM_WORLD)
        problem.close()
        nodes = math.prod(round(degree * length) + 1 for length in size)
        return 3 * nodes, problem.domain.compact_size(3 * nodes, degree)

    cube, as_cube = sizes(8.0, 8.0, 8.0)
    assert as_cube == pytest.approx(cube, rel=0.2)
    plate, as_plate = sizes(40.0, 40.0, 1.0)
    assert as_plate < 0.7 * plate


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("linear", ["direct", "iterative"])
def test_more_unknowns_and_more_steps_take_longer_and_more_unknowns_take_more_memory(
    dim: int, linear: str
) -> None:
    sizes = [round(10 ** (k / 4)) for k in range(8, 33)]
    found = [expected(dim, size, solver__linear=linear) for size in sizes]
    for less, more in itertools.pairwise(found):
        assert less.seconds < more.seconds and less.memory < more.memory
    process = expected(dim, 10**4, solver__linear=linear, steps={"to": 1, "count": 10})
    assert process.seconds > 5 * expected(dim, 10**4, solver__linear=linear).seconds


@pytest.mark.serial
def test_a_solve_that_does_more_of_the_same_takes_longer() -> None:
    once = expected(2, 10**4)
    more: list[dict[str, Any]] = [
        {"solver__friction": "nested"},
        {"certificate__limit": True},
        {"adapt": {"max_dofs": 10**5}},
    ]
    assert all(expected(2, 10**4, **changes).seconds > 1.5 * once.seconds for changes in more)
    elastic = expected(2, 10**4, contact=[], material__locking_limit=float("inf"))
    assert elastic.seconds < 0.7 * once.seconds
    # No limit of the strain, nothing to project.
    large, pressed = (
        expected(3, 10**6, material__locking_limit=limit) for limit in (0.02, math.inf)
    )
    assert pressed.seconds < 0.5 * large.seconds


@pytest.mark.serial
def test_more_ranks_take_more_memory_and_less_time_but_direct_solves_only_up_to_two() -> None:
    direct = [expected(3, 40_000, ranks) for ranks in (1, 2, 8)]
    assert direct[0].memory < direct[1].memory < direct[2].memory
    assert direct[0].seconds > direct[1].seconds == direct[2].seconds
    iterative = [expected(3, 10**6, ranks).seconds for ranks in (1, 2, 8)]
    assert iterative[0] > iterative[1] > iterative[2]


def test_the_probe_takes_no_time_and_all_ranks_have_one_estimate(comm: MPI.Intracomm) -> None:
    assert 0.01 < probe.speed() < 100.0
    facts = check(block(), comm)
    assert len(set(comm.allgather(facts["estimate"]))) == 1
    assert facts["estimate"].ranks == comm.size
    assert 0.2 < facts["estimate"].memory / comm.size / 1e9 < 0.4


def test_a_solve_that_is_too_large_for_the_machine_is_warned_of(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    parameters = block(friction__smoothing__radius=0.2)
    assert check(parameters, comm)["warnings"] == []
    monkeypatch.setattr(probe, "memory", lambda: 1e8 if comm.rank == comm.size - 1 else None)
    (warning,) = check(parameters, comm)["warnings"]
    assert "by an estimate, and this machine has 0.1 GB; take a coarser mesh" in warning


@pytest.mark.serial
def test_check_names_the_estimate_an_estimate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "study.yml"
    file.write_text(SMALL_BLOCK)
    assert cli.main(["check", str(file), "--set", f"output.directory={tmp_path}/out"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"estimated memory +about 0\.\d GB in all, on 1 rank\n", shown)
    assert re.search(r"estimated time +about \d\.\d s, within a factor of 3\n", shown)
    words = ["--set", "adapt={max_dofs: 200000}"]
    assert cli.main(["check", str(file), "--set", f"output.directory={tmp_path}/out", *words]) == 0
    assert capsys.readouterr().out.count("at most about") == 2
    large = forecast.rows(forecast.Estimate(9e9, 1e4, 4, "at least"))
    assert dict(large)["estimated memory"] == "at least about 9.0 GB in all, on 4 ranks"
    assert dict(large)["estimated time"] == "at least about 2 h 47 min"
