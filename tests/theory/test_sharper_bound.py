"""The guaranteed bound of a solution, sharpened by displacements on finer meshes."""

from __future__ import annotations

import math
from typing import Any

import pytest
from bounded_block import benchmark
from problems import block
from test_kappa import block as clamped_on_top

from contact_locking import StudySolution, solve
from contact_locking.problem.distance import distance
from contact_locking.process.adaptivity.sharper_bound import on_mesh_of
from contact_locking.results.in_words import rows
from contact_locking.study.assembly import assemble

QUADRATIC = {"discretisation__degree": 2, "material__locking_limit": 0.02}


def found(divisions: int, meshes: int | None, **changes: Any) -> StudySolution:
    changes = QUADRATIC | {"certificate__bound_meshes": meshes} | changes
    return solve(benchmark(divisions, **changes))


def bound(solution: StudySolution) -> dict[str, Any]:
    return dict(solution.summary["certificate"]["errors"]["guaranteed"])


def error(solution: StudySolution, reference: StudySolution) -> float:
    """The energy norm of the distance; collective."""
    u = on_mesh_of(solution.displacement, reference.displacement)
    data = assemble(reference.parameters, reference.domain.comm, reference.domain).data
    return distance(u, reference.displacement, data)["energy_norm"]


def test_finer_meshes_make_the_bound_sharper_and_keep_it_above_the_error() -> None:
    vertices = {"discretisation__limit_at": "vertices"}
    plain, sharper = (found(4, meshes, penalty__n=1e4, **vertices) for meshes in (None, 2))
    apart = error(sharper, found(8, None, **vertices))
    assert apart < bound(sharper)["energy_norm"] < 0.7 * bound(plain)["energy_norm"]
    size = math.sqrt(2.0 * sharper.summary["elastic_energy"])
    assert bound(sharper)["relative"] == pytest.approx(bound(sharper)["energy_norm"] / size)
    assert "the solution for n = .inf on" in bound(sharper)["reason"]
    assert (
        "for the friction bound of the solution on a finer mesh"
        in dict(rows(sharper.summary))["proved"]
    )


def test_limits_at_gauss_points_get_a_bound_from_limits_at_the_vertices() -> None:
    gauss = {"discretisation__limit_at": "gauss"}
    assert "take discretisation.limit_at: vertices" in bound(found(4, None, **gauss))["reason"]
    sharper = found(4, 1, **gauss)
    assert bound(sharper)["applicable"] and bound(sharper)["relative"] < 1.0


def test_the_bound_with_the_friction_bound_that_moves_becomes_sharper_too() -> None:
    given: dict[str, Any] = {"certificate__error_bound": True, "penalty__n": 1e4}
    plain, sharper = (
        solve(clamped_on_top(0.25, certificate__bound_meshes=meshes, **given))
        for meshes in (None, 2)
    )
    before, after = (
        one.summary["certificate"]["errors"]["moving_friction"] for one in (plain, sharper)
    )
    assert after["energy_norm"] < before["energy_norm"]
    assert after["estimated"] is False


@pytest.mark.serial
@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, r"add certificate\.error_bound: true"),
        ({"certificate__error_bound": True, "adapt": {}}, "does not go with adapt"),
    ],
)
def test_finer_meshes_take_the_bound_of_one_solution(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        block(certificate__bound_meshes=1, **changes)
