"""Pressures as loads, reactions of named boundary parts, and probes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block

from contact_locking import InputError, Parameters, solve, solve_steps, study_file
from contact_locking.monitor import Monitor
from contact_locking.problem.assembly import assemble
from contact_locking.results import probe_table
from contact_locking.running import run_steps
from contact_locking.study_file import from_mapping

# The fingerprint that the problem without pressures had before there were pressures.
FORMER_FINGERPRINT = "b5af12d064c83503"
BOTH_DEGREES = pytest.mark.parametrize("degree", [1, 2])


def square(**changes: Any) -> Parameters:
    """A small block on a foundation with friction, clamped on the right."""
    given: dict[str, Any] = {
        "h": 0.25,
        "mesh__structured": True,
        "material__locking_limit": 0.05,
        "penalty__n": math.inf,
        "loads": {
            "pressures": [{"on": "top", "value": "0.04 + 0.02*x"}, {"on": "left", "value": -0.01}],
            "displacements": [{"on": "right", "value": [0, 0]}],
        },
    }
    return block(**(given | changes))


# Pressures ----------------------------------------------------------------------------------------


@BOTH_DEGREES
@pytest.mark.parametrize("dim", [2, 3])
def test_equal_pressures_on_all_free_sides_give_the_hydrostatic_stress(
    dim: int, degree: int
) -> None:
    held = ["left", "bottom"] if dim == 2 else ["left", "front", "bottom"]
    free = ["right", "top"] if dim == 2 else ["right", "back", "top"]
    rollers = [
        {"on": name, "value": [0 if axis == other else None for other in range(dim)]}
        for axis, name in enumerate(held)
    ]
    solution = solve(
        block(
            dim,
            0.5,
            loads={"pressures": [{"on": free, "value": 0.03}], "displacements": rollers},
            contact=[],
            discretisation={"degree": degree},
            material__locking_limit=math.inf,
        )
    )
    assert solution.converged
    stress = solution.elastic_stress.x.array.reshape(-1, dim, dim)
    assert np.abs(stress + 0.03 * np.eye(dim)).max() < 1e-9


@BOTH_DEGREES
def test_a_pressure_on_a_flat_side_is_the_traction_along_minus_its_normal(degree: int) -> None:
    more = {"discretisation": {"degree": degree}, "certificate__error_bound": degree == 1}
    held = [{"on": "right", "value": [0, 0]}]
    tractions = [{"on": "top", "value": [0, "-0.04 - 0.02*x"]}, {"on": "left", "value": [-0.01, 0]}]
    found = solve(square(**more))
    wanted = solve(square(loads={"tractions": tractions, "displacements": held}, **more))
    assert found.converged
    largest = np.abs(wanted.displacement.x.array).max(initial=0.0)
    difference = found.displacement.x.array - wanted.displacement.x.array
    assert np.abs(difference).max(initial=0.0) <= 1e-9 * largest + 1e-15
    errors = [one.summary["certificate"]["errors"] for one in (found, wanted)]
    if degree == 1:
        first, second = (entry["guaranteed"] for entry in errors)
        assert first["applicable"]
        assert first["energy_norm"] == pytest.approx(second["energy_norm"], rel=1e-6)


def test_one_pressure_on_two_sides_of_a_corner_has_the_bound_of_two_pressures() -> None:
    def bound(pressures: list[dict[str, Any]]) -> Any:
        loads = {"pressures": pressures, "displacements": [{"on": "right", "value": [0, 0]}]}
        found = solve(square(loads=loads, certificate__error_bound=True)).summary
        return found["certificate"]["errors"]["guaranteed"]

    value = "0.03 + 0.01*x*y"
    together = bound([{"on": ["top", "left"], "value": value}])
    apart = bound([{"on": "top", "value": value}, {"on": "left", "value": value}])
    assert together["applicable"]
    assert together["energy_norm"] == pytest.approx(apart["energy_norm"], rel=1e-6)


def test_the_resultant_of_a_pressure_on_a_quarter_circle_is_exact() -> None:
    parameters = from_mapping(
        {
            "mesh": {"builder": "annulus", "quarter": True, "h": 0.3},
            "loads": {
                "pressures": [{"on": "inner", "value": 0.02}],
                "displacements": [
                    {"on": "left", "value": [0, None]},
                    {"on": "bottom", "value": [None, 0]},
                ],
            },
            "contact": [],
            "certificate": {"error_bound": True},
        }
    )
    summary = solve(parameters).summary
    geometry: Any = parameters.mesh.geometry
    # The polygon of the facets has the end points of the arc.
    wanted = [0.02 * geometry.inner_radius] * 2
    assert summary["converged"]
    assert summary["certificate"]["resultants"]["loads"] == pytest.approx(wanted, rel=1e-9)
    assert summary["certificate"]["errors"]["guaranteed"]["applicable"]


def test_a_pressure_follows_the_time_of_the_steps() -> None:
    loads = {
        "pressures": [{"on": "top", "value": "0.04*t"}],
        "displacements": [{"on": "right", "value": [0, 0]}],
    }
    forces = [
        solution.summary["certificate"]["resultants"]["loads"][1]
        for solution in solve_steps(square(loads=loads, steps={"times": [0.5, 1.0]}))
    ]
    assert forces == pytest.approx([-0.02, -0.04])


@pytest.mark.parametrize(
    ("pressure", "key", "words"),
    [
        ({"on": "roof", "value": 1}, "loads.pressures.0.on", "no part of the boundary"),
        ({"on": "top", "value": [0, 1]}, "loads.pressures.0.value", "must be a number"),
        ({"on": "top", "value": "0.1*t"}, "loads.pressures.0.value", "has no steps"),
        ({"on": "top", "value": "0.1*z"}, "loads.pressures.0.value", "in 2D"),
    ],
)
def test_a_wrong_pressure_is_refused_with_its_key(
    pressure: dict[str, Any], key: str, words: str
) -> None:
    given = {"mesh": {"builder": "block"}, "loads": {"pressures": [pressure]}}
    with pytest.raises(InputError, match=words) as caught:
        from_mapping(given)
    assert key in str(caught.value)


def test_a_pressure_that_is_not_finite_is_refused_with_its_key() -> None:
    loads = {
        "pressures": [{"on": "top", "value": "0.01*log(x - 0.5)"}],
        "displacements": [{"on": "right", "value": [0, 0]}],
    }
    with pytest.raises(InputError) as caught:
        solve(square(loads=loads))
    assert caught.value.key == "loads.pressures.0.value"


def test_tractions_and_pressures_have_one_limit_together() -> None:
    tractions = [{"on": "top", "value": [0, 0]}] * 150
    loads = {"tractions": tractions, "pressures": [{"on": "top", "value": 0}] * 51}
    with pytest.raises(InputError, match="at most 200"):
        from_mapping({"mesh": {"builder": "block"}, "loads": loads})


def test_pressures_count_in_the_fingerprint_and_no_pressures_do_not() -> None:
    held = {"displacements": [{"on": "right", "value": [0, 0]}]}
    pressures: list[dict[str, Any]] = [
        {},
        {"pressures": []},
        {"pressures": [{"on": "top", "value": 0.1}]},
        {"pressures": [{"on": "top", "value": 0.2}]},
    ]
    names = [study_file.fingerprint(square(loads=held | more)) for more in pressures]
    assert names[0] == names[1] == FORMER_FINGERPRINT
    assert len(set(names)) == 3


# Reactions ----------------------------------------------------------------------------------------


@BOTH_DEGREES
def test_the_reactions_of_all_parts_add_up_to_those_of_the_certificate(degree: int) -> None:
    # Left and top share a node, which both of them hold in both directions.
    loads = {
        "body_force": [0.01, -0.02],
        "displacements": [
            {"on": ["left", "top"], "value": [0.001, -0.002]},
            {"on": "right", "value": [None, 0]},
        ],
    }
    solution = solve(square(loads=loads, discretisation={"degree": degree}))
    found = solution.summary["reactions"]
    assert solution.converged
    assert list(found) == ["left", "top", "right"]
    assert found["right"][0] == 0.0
    total = np.sum(list(found.values()), axis=0)
    wanted = solution.summary["certificate"]["resultants"]["reactions"]
    assert total == pytest.approx(wanted, rel=1e-12, abs=1e-15)


def test_a_support_pushes_back_with_the_load_that_it_carries() -> None:
    # Rollers below and on the left, a pressure of 0.03 above: the support below carries all of it.
    loads = {
        "pressures": [{"on": "top", "value": 0.03}],
        "displacements": [
            {"on": "left", "value": [0, None]},
            {"on": "bottom", "value": [None, 0]},
        ],
    }
    summary = solve(square(loads=loads, contact=[])).summary
    assert summary["reactions"]["bottom"] == pytest.approx([0.0, 0.03], abs=1e-10)
    assert summary["reactions"]["left"] == pytest.approx([0.0, 0.0], abs=1e-10)


def test_the_history_has_the_reactions_of_each_part() -> None:
    loads = {
        "pressures": [{"on": "top", "value": "0.04*t"}],
        "displacements": [
            {"on": "left", "value": [0, None]},
            {"on": "right", "value": [0, 0]},
        ],
    }
    *_, last = solve_steps(square(loads=loads, steps={"times": [0.5, 1.0]}))
    for axis, name in enumerate("xy"):
        parts = [last.history.column(f"reaction_{part}_{name}") for part in ("left", "right")]
        assert np.sum(parts, axis=0) == pytest.approx(last.history.column(f"reaction_{name}"))
        assert parts[1][-1] == last.summary["reactions"]["right"][axis]


# Probes -------------------------------------------------------------------------------------------

POINTS = [[0.5, 0.5], [0.1, 0.7], [1.0, 1.0], [0.5, 0.0]]
PROBES = [{"points": POINTS}, {"line": {"from": [0, 0.5], "to": [1, 0.5], "count": 5}}]


def table(text: str) -> dict[str, list[float]]:
    """The columns of probes.csv."""
    header, *lines = text.splitlines()
    values = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    return dict(zip(header.split(","), map(list, values.T), strict=True))


def probed(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Any:
    """The table that the run writes, the same on all ranks."""
    solution = solve(parameters, comm)
    return comm.bcast(probe_table.text(solution.probes) if comm.rank == 0 else None)


@BOTH_DEGREES
@pytest.mark.parametrize("dim", [2, 3])
def test_probes_of_a_homogeneous_state_have_its_values(dim: int, degree: int) -> None:
    # An elastic block between rollers below and on the left, under a pressure from above.
    names = ["left", "bottom"] if dim == 2 else ["left", "front", "bottom"]
    rollers = [
        {"on": name, "value": [0 if axis == other else None for other in range(dim)]}
        for axis, name in enumerate(names)
    ]
    inner = [0.3, 0.6, 0.2][:dim]
    found = table(
        probed(
            block(
                dim,
                0.5,
                loads={
                    "pressures": [{"on": "top", "value": 0.03}],
                    "displacements": rollers,
                },
                contact=[],
                discretisation={"degree": degree},
                material__locking_limit=math.inf,
                output={"probes": [{"points": [inner]}]},
            )
        )
    )
    axes = "xyz"[:dim]
    last = axes[-1]
    for i, first in enumerate(axes):
        for second in axes[i:]:
            wanted = -0.03 if first == second == last else 0.0
            assert found[f"stress_{first}{second}"] == pytest.approx([wanted], abs=1e-9)
            assert found[f"locking_stress_{first}{second}"] == pytest.approx([0.0], abs=1e-9)
    # With E = 1 and nu = 0.3; a body in 2D is in plane strain.
    along, across = (-0.03 * 0.91, 0.03 * 0.39) if dim == 2 else (-0.03, 0.009)
    strains = [across] * (dim - 1) + [along]
    for axis, strain, x in zip(axes, strains, inner, strict=True):
        assert found[f"u_{axis}"] == pytest.approx([strain * x], abs=1e-9)
    assert found["strain_norm"] == pytest.approx([np.linalg.norm(strains)], abs=1e-9)


@BOTH_DEGREES
def test_probes_do_not_depend_on_the_ranks(degree: int) -> None:
    parameters = square(output={"probes": PROBES}, discretisation={"degree": degree})
    together = table(probed(parameters))
    alone = table(probed(parameters, MPI.COMM_SELF))
    assert list(together) == list(alone)
    assert "step" not in together
    assert together["probe"] == [0] * 4 + [1] * 5
    assert together["point"] == [*range(4), *range(5)]
    assert together["x"] == [0.5, 0.1, 1.0, 0.5, 0.0, 0.25, 0.5, 0.75, 1.0]
    for name, values in together.items():
        assert values == pytest.approx(alone[name], abs=1e-7), name
    # The middle of the block is a point of both probes.
    for name in set(together) - {"probe", "point"}:
        assert together[name][0] == together[name][6]


def test_a_held_point_has_its_prescribed_displacement_and_a_node_of_contact_its_own() -> None:
    solution = solve(square(output={"probes": PROBES}))
    if solution.contact_points is None:
        return
    found = table(probe_table.text(solution.probes))
    # Interpolation multiplies the other nodes by the rounding of zero.
    assert [found["u_x"][8], found["u_y"][8]] == pytest.approx([0.0, 0.0], abs=1e-15)
    points = solution.contact_points
    (row,) = np.flatnonzero(np.isclose(points.x[:, 0], 0.5))
    assert found["u_y"][3] == pytest.approx(-points.u_normal[row], rel=1e-12)


class _Stopping(Monitor):
    """Stops a process before its second step."""

    def step(self, number: int, left: int, time: float, seconds_left: float | None) -> None:
        if number == 2:
            raise KeyboardInterrupt


@pytest.mark.parametrize("stopped", [False, True])
def test_a_process_has_a_row_for_each_step_and_point(tmp_path: Path, stopped: bool) -> None:
    folder = MPI.COMM_WORLD.bcast(tmp_path)
    loads = {
        "pressures": [{"on": "top", "value": "0.04*t"}],
        "displacements": [{"on": "right", "value": [0, 0]}],
    }
    output = {"probes": PROBES, "fields": False, "picture": False}
    parameters = square(loads=loads, steps={"times": [0.5, 1.0]}, output=output)
    if stopped:
        with pytest.raises(KeyboardInterrupt):
            run_steps(parameters, folder, monitor=_Stopping())
    solution, _ = run_steps(parameters, folder)
    found = table((folder / "probes.csv").read_text())
    assert found["step"] == [1] * 9 + [2] * 9
    assert found["t"] == [0.5] * 9 + [1.0] * 9
    assert solution.converged


@pytest.mark.parametrize(
    ("probe", "key"),
    [
        ({"points": [[0.5, 0.5], [0.5, 1.01]]}, "output.probes.1.points.1"),
        ({"line": {"from": [0.5, 0.5], "to": [1.5, 0.5], "count": 3}}, "output.probes.1.line"),
    ],
)
def test_a_point_outside_of_the_body_is_refused_before_the_solve(probe: Any, key: str) -> None:
    with pytest.raises(InputError, match="outside of the mesh") as caught:
        assemble(square(output={"probes": [{"points": [[0, 0]]}, probe]}), MPI.COMM_WORLD)
    assert caught.value.key == key


@pytest.mark.parametrize(
    ("probes", "words"),
    [
        ([{}], "exactly one of points and line"),
        ([{"points": [[0, 0, 0]]}], "must have 2 components in 2D"),
        ([{"line": {"from": [0, 0], "to": [1, 0, 0], "count": 3}}], "must have 2 coordinates"),
        ([{"line": {"from": [0, 0], "to": [1, 0], "count": 1}}], "count"),
        ([{"line": {"from": [0, 0], "to": [1, 0], "count": 9000}}] * 2, "18000 points"),
    ],
)
def test_wrong_probes_are_refused_with_their_key(probes: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        from_mapping({"mesh": {"builder": "block"}, "output": {"probes": probes}})
    assert "output.probes" in str(caught.value)


def test_probes_count_in_the_fingerprint_and_survive_a_dump() -> None:
    held = {"displacements": [{"on": "right", "value": [0, 0]}]}
    without = square(loads=held, output={"probes": []})
    some = square(loads=held, output={"probes": PROBES})
    assert study_file.fingerprint(without) == FORMER_FINGERPRINT
    assert study_file.fingerprint(some) != FORMER_FINGERPRINT
    assert "from:" in study_file.dump(some)
