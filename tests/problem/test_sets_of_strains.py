"""Sets of strains: against Clarabel, by both solvers, by region, in any unit, infeasible."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import SEVERAL, block, column, material
from slow import slow
from sweep.reference import of_solution

from contact_locking.certificate.solved_state import SolvedState
from contact_locking.certificate.verdict import certify
from contact_locking.process import problem_solver
from contact_locking.running import solving
from contact_locking.running.assembly import assemble
from contact_locking.study_file import from_mapping
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial


def solved(parameters: Parameters) -> dict[str, Any]:
    summary = {**solving.solve(parameters).summary}
    assert summary["converged"], summary["reason"]
    return summary


def random_limits(random: np.random.Generator, dim: int) -> list[dict[str, Any]]:
    """A limit of each kind but that of the ball."""
    size = dim * (dim + 1) // 2
    shape, least, most, slack, weight = random.uniform(0.005, 0.015, 5)
    matrix = np.eye(size) + 0.3 * random.standard_normal((size, size))
    return [
        {"norm": "deviator", "at_most": shape},
        {"norm": "volume", "at_least": -least, "at_most": most},
        {"norm": "direction", "along": random.standard_normal(dim).tolist(), "at_most": slack},
        {"norm": "weighted", "matrix": matrix.tolist(), "at_most": weight},
    ]


@pytest.mark.parametrize(
    ("seed", "dim", "n"),
    [
        (1, 2, math.inf),
        slow(2, 2, math.inf),
        (3, 2, 1e3),
        slow(4, 2, 30.0),
        slow(5, 3, math.inf),
    ],
)
def test_random_sets_of_strains_agree_with_the_conic_solver(seed: int, dim: int, n: float) -> None:
    pytest.importorskip("clarabel")
    limits = random_limits(np.random.default_rng(seed), dim)
    h = 0.1 if dim == 2 else 0.35
    penalty = {"n": n, "epsilon": None if math.isinf(n) else 1e-3}
    solution = solving.solve(block(dim, h, material=material(*limits), penalty=penalty))
    assert solution.converged, solution.summary["reason"]
    assert solution.summary["locked_fraction"] > 0.1
    reference = of_solution(solution)
    u = reference.minimiser(tol_gap_rel=1e-10, tol_gap_abs=1e-12, tol_feas=1e-11)
    ours = solution.displacement.x.array
    assert reference.energy(ours) == pytest.approx(reference.energy(u), rel=1e-7)
    np.testing.assert_allclose(ours, u, atol=1e-4 * np.abs(u).max())


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_the_entry_of_the_ball_is_the_locking_limit_to_the_last_digit(n: float) -> None:
    ball = {"norm": "strain", "at_most": 0.02}
    long = solved(block(2, 0.2, material=material(ball), penalty__n=n))
    short = solved(block(2, 0.2, penalty__n=n))
    for summary in (long, short):
        del summary["fingerprint"], summary["wall_seconds"]
    assert long == short
    assert long["strain_sets"] == []


def test_a_region_has_its_own_limits_in_place_of_all_of_the_material() -> None:
    mesh = {"builder": "inclusion", "h": 0.2}
    loads = {
        "displacements": [{"on": "bottom", "value": [0, 0]}],
        "tractions": [{"on": "top", "value": [0.0, -0.05]}],
    }
    regions = {"inclusion": {"locking": [{"norm": "volume", "at_least": -0.001}]}}
    given: dict[str, Any] = {
        "mesh": mesh, "loads": loads, "contact": {"on": []}, "penalty": {"n": math.inf},
        "material": material({"norm": "deviator", "at_most": 0.03}, regions=regions),
    }  # fmt: skip
    problem = assemble(from_mapping(given), MPI.COMM_WORLD)
    shape, volume = problem.data.limits
    assert [shape.name, volume.name] == ["deviator", "volume at_least"]
    assert vars(shape)["least"] == pytest.approx(math.sqrt(1 / 3))  # where eps_xx = eps_yy
    limited = [item.inverse_limit.x.array > 0.0 for item in (shape, volume)]
    assert np.array_equal(limited[0], ~limited[1])
    used = {e["name"]: e["utilisation_max"] for e in solved(from_mapping(given))["strain_sets"]}
    assert used == pytest.approx({"deviator": 1.0, "volume at_least": 1.0}, abs=1e-6)
    # A limit of the ball in a region replaces all limits there as well, and so does no limit.
    others: list[dict[str, Any]] = [{"locking_limit": 0.1}, {"locking": []}]
    for none in others:
        given["material"]["regions"] = {"inclusion": none}
        (shape,) = assemble(from_mapping(given), MPI.COMM_WORLD).data.limits
        assert np.array_equal(shape.inverse_limit.x.array > 0.0, limited[0])


@pytest.mark.parametrize(
    ("limit", "factor"),
    [
        ({"norm": "volume", "at_least": -0.01}, 0.5),
        ({"norm": "direction", "along": [0, 1], "at_least": -0.008}, 0.4),
        ({"norm": "deviator", "at_most": 0.01 * math.sqrt(2.0 / 3.0)}, 0.5),
    ],
)
def test_displacements_that_no_limit_allows_are_proved_to_be_infeasible(
    limit: dict[str, Any], factor: float
) -> None:
    """A column of height 2 that is to be 0.04 shorter has the strain 0.02."""
    given = column(2, 0.0, material=material(limit), penalty={"n": math.inf})
    data = given.model_dump(by_alias=True)
    data["loads"]["tractions"] = []
    data["loads"]["displacements"] = [
        *data["loads"]["displacements"],
        {"on": ["top"], "value": [None, -0.04]},
        {"on": ["bottom"], "value": [None, 0.0]},
    ]
    data["contact"] = {"on": []}
    summary = solving.solve(Parameters.model_validate(data)).summary
    assert not summary["converged"]
    assert summary["reason"].startswith("infeasible")
    low, high = summary["admissible_load_factor"]
    # What is excluded may be the factor itself, but for rounding.
    assert low <= factor
    assert (1.0 - 1e-12) * factor <= high <= 1.02 * factor


def test_a_half_space_that_pulls_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fibres bear no pressure: a multiplier below zero breaks the law of each kind of point."""

    def tampered(state: SolvedState, *more: Any) -> Any:
        state.body.locking_parts[1].x.array[:] -= 0.01
        return certify(state, *more)

    monkeypatch.setattr(problem_solver, "certify", tampered)
    limit = {"norm": "direction", "along": [1, 0], "at_most": 0.005}
    summary = solving.solve(block(2, 0.25, material=material(limit), penalty__n=1e3)).summary
    criteria = summary["certificate"]["criteria"]
    assert not criteria["locking_violation"]["holds"]
    assert summary["converged"] is False


def test_the_bound_of_the_error_in_n_is_above_the_measured_distance() -> None:
    given = block(2, 0.2, material=material(*SEVERAL), certificate={"limit": True})
    errors = solved(given)["certificate"]["errors"]
    bound, measured = errors["penalty"]["energy_norm"], errors["penalty_measured"]["energy_norm"]
    assert 0.0 < measured <= bound
