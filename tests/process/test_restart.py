"""A restart never changes what is found, only the way there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI
from problems import block
from slow import slow

from contact_locking import save
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters


@pytest.fixture
def folder(comm: MPI.Intracomm, tmp_path: Path) -> Path:
    """One folder for all ranks."""
    return comm.bcast(tmp_path)


def given(method: str, dim: int = 2, load: float = 1.0, **changes: Any) -> Parameters:
    """The model case with its traction times ``load``."""
    pull = [0.03 * load, *[0.0] * (dim - 2), -0.05 * load]
    loads = {
        "tractions": [{"on": "top", "value": pull}],
        "displacements": [{"on": "left", "value": [0.0] * dim}],
    }
    h = 0.1 if dim == 2 else 0.34
    return block(dim, h, **{"solver__method": method, "loads": loads, **changes})


def tangents(solution: StudySolution) -> int:
    return int(solution.summary["iterations"]["tangents"])


def agree(one: StudySolution, other: StudySolution, digits: float = 1e-8) -> bool:
    assert one.converged and other.converged, (one.summary["reason"], other.summary["reason"])
    for key in ("compliance", "elastic_energy", "strain_norm_max"):
        assert one.summary[key] == pytest.approx(other.summary[key], rel=digits), key
    for key in ("contact_force", "friction_force"):
        assert one.summary[key] == pytest.approx(other.summary[key], rel=10 * digits, abs=1e-9), key
    return True


CHANGES: dict[str, dict[str, Any]] = {
    "friction": {"friction__coefficient": 0.33},
    "no limit": {"material__locking_limit": float("inf")},
    "gap": {"contact__gap": 1e-3},
    "no friction": {"friction__coefficient": 0.0},
}


@pytest.mark.serial
@pytest.mark.parametrize("n", [slow(1e8), float("inf")])
def test_a_start_from_other_data_finds_what_a_cold_start_finds_in_few_more_tangents(
    n: float, folder: Path
) -> None:
    save(solving.solve(given("auto", penalty__n=n)), folder)
    assert tangents(solving.solve(given("auto", penalty__n=n), restart=folder)) == 0
    # Without a limit, or friction, the saved stresses would still be in equilibrium.
    for name in ("friction", "no limit", "no friction", "gap"):
        changed = given("auto", penalty__n=n, **CHANGES[name])
        restarted, cold = solving.solve(changed, restart=folder), solving.solve(changed)
        assert agree(restarted, cold), name
        assert tangents(restarted) <= tangents(cold) + 10, name


@pytest.mark.serial
@pytest.mark.parametrize("changes", [{"load": 1.01}, {"friction__coefficient": 0.33}])
def test_a_small_change_takes_half_of_the_tangents_at_most(
    changes: dict[str, Any], folder: Path
) -> None:
    # Many cells are at the edge of locking on a mesh as fine as this.
    fine: dict[str, Any] = {"mesh__h": 1 / 32, "penalty__n": 1e4}
    save(solving.solve(given("auto", **fine)), folder)
    changed = given("auto", **fine, **changes)
    restarted, cold = solving.solve(changed, restart=folder), solving.solve(changed)
    assert restarted.summary["restart"].startswith("from the state")
    assert agree(restarted, cold)
    assert 2 * tangents(restarted) <= tangents(cold)
