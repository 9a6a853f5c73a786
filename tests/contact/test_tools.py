"""Tools: rigid foundations that move, and the friction by which they drag the body."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block
from slow import slow

from contact_locking import Parameters, save, solve, solve_steps
from contact_locking.parallel import maximum
from contact_locking.results.contact_points import SLIP, STICK
from contact_locking.results.solution import StudySolution
from contact_locking.study_file import from_mapping

WAY = ["0.02*sin(6*t)", "0.02*min(4*t, 1)"]


def pressed(dim: int, n: float, top: list[Any], motion: Any, **changes: Any) -> Parameters:
    """A block held at its top, and a half space below."""
    point, normal = [0.0] * dim, [*[0.0] * (dim - 1), 1.0]
    foundation: dict[str, Any] = {"half_space": {"point": point, "normal": normal}}
    if motion is not None:
        foundation["motion"] = motion
    given: dict[str, Any] = {
        "h": 0.25 if dim == 2 else 0.5,
        "loads": {"displacements": [{"on": "top", "value": top}]},
        "contact": {"on": "bottom", "foundation": foundation},
        "steps": {"times": [0.25, 0.4, 0.75]},
        "material__locking_limit": 0.04,
        "friction__coefficient": 0.2,
        "penalty__n": n,
        "solver__tolerance": 1e-11,
        "solver__friction_tolerance": 1e-11,
    }
    return block(dim, **(given | changes))


def in_space(way: list[str], dim: int) -> list[str]:
    return way if dim == 2 else [way[0], "0.01*t", way[1]]


def all_of(parameters: Parameters) -> list[StudySolution]:
    solutions = list(solve_steps(parameters))
    assert all(found.converged for found in solutions), solutions[-1].summary["reason"]
    return solutions


@pytest.mark.parametrize(("dim", "n"), [(2, 1e3), (2, math.inf), slow(3, math.inf)])
def test_a_tool_that_moves_is_a_body_that_moves_the_other_way(dim: int, n: float) -> None:
    way = in_space(WAY, dim)
    moved = all_of(pressed(dim, n, [0.0] * dim, way))
    fixed = all_of(pressed(dim, n, [f"-({value})" for value in way], None))
    states: set[int] = set()
    for a, b in zip(moved, fixed, strict=True):
        t = a.time
        by = [0.02 * math.sin(6 * t), *[0.01 * t] * (dim - 2), 0.02 * min(4 * t, 1)]
        u, w = (found.displacement.x.array.reshape(-1, dim) for found in (a, b))
        assert np.abs(u - by - w).max(initial=0.0) < 1e-9
        one, other = a.contacts[0], b.contacts[0]
        for name in ("pressure", "traction", "bound", "slip", "increment"):
            x, y = getattr(one, name), getattr(other, name)
            assert np.abs(x - y).max(initial=0.0) < 1e-9, name
        assert np.array_equal(one.state, other.state)
        states |= set(MPI.COMM_WORLD.allreduce(one.state.tolist()))
        for name in ("elastic_energy", "contact_force", "friction_force"):
            assert a.summary[name] == pytest.approx(b.summary[name], abs=1e-9)
        # The work differs only by the force with which the support moved or did not.
        for name in ("stored", "dissipated"):
            x, y = (found.history.last(name) for found in (a, b))
            assert x == pytest.approx(y, abs=1e-10)
        assert a.summary["certificate"]["criteria"]["energy_balance"]["holds"]
    assert {SLIP, STICK} <= states


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_in_one_static_solve_friction_sees_that_the_tool_has_moved(n: float) -> None:
    way = [0.03, 0.02]
    moved = solve(pressed(2, n, [0.0, 0.0], way, steps=None))
    fixed = solve(pressed(2, n, [-value for value in way], None, steps=None))
    u, w = (found.displacement.x.array.reshape(-1, 2) for found in (moved, fixed))
    assert np.abs(u - way - w).max() < 1e-9
    assert moved.summary["friction_force"][0] > 1e-3


@pytest.mark.parametrize("n", [slow(1e3), math.inf])
@pytest.mark.parametrize(
    "motion",
    [
        ["0.3*t", "0.03*min(3*t, 1)"],
        {"translation": [0, 0.03], "rotation": "0.1*sin(5*t)", "about": [0.4, -1.0]},
    ],
    ids=["slides", "rolls"],
)
def test_no_tool_creates_energy_whatever_its_normals_do(n: float, motion: Any) -> None:
    disc = {"sphere": {"centre": [0.4, -1.0], "radius": 1.0}, "motion": motion}
    found = all_of(
        pressed(
            2,
            n,
            [0.0, 0.0],
            None,
            h=0.125,
            contact={"on": "bottom", "foundation": disc},
            steps={"to": 0.8, "count": 4},
            material__locking_limit=0.08,
        )
    )
    for before, after in itertools.pairwise(found):
        assert after.history.last("numerical") >= -1e-12
        assert after.history.last("energy_defect") < 1e-8
        turned = np.abs(after.contacts[0].normal - before.contacts[0].normal).max(initial=0.0)
        assert (maximum(MPI.COMM_WORLD, turned) > 1e-3) == isinstance(motion, list)
    assert found[-1].history.last("dissipated_total") > 0.0


def test_a_tool_stands_where_its_motion_has_brought_it() -> None:
    def solved(centre: list[float], motion: Any) -> StudySolution:
        disc: dict[str, Any] = {"sphere": {"centre": centre, "radius": 1.0}}
        contact = {"on": "bottom", "foundation": disc | motion}
        return solve(
            pressed(2, 1e3, [0, 0], None, contact=contact, friction__coefficient=0.0, steps=None)
        )

    there = solved([0.4, -0.97], {})
    moved = solved([0.1, -1.0], {"motion": [0.3, 0.03]})
    # Without friction a turn about the centre changes nothing.
    turned = {"translation": [0.3, 0.03], "rotation": 0.3, "about": [0.1, -1.0]}
    for other in (moved, solved([0.1, -1.0], {"motion": turned})):
        difference = there.displacement.x.array - other.displacement.x.array
        assert np.abs(difference).max() < 1e-10


def test_a_gap_that_moves_has_the_control_values_of_quadratic_displacements() -> None:
    bent = {"contact__gap": "0.02*t*x**2", "steps": {"times": [0.5, 1.0]}}
    *_, last = all_of(block(2, 0.5, discretisation={"degree": 2}, **bent))
    surface = last.contacts[0].surface
    nodal = 0.02 * surface.points[:, 0] ** 2
    wanted = surface.limited.of_function(surface.scalar_function(nodal))
    assert last.contacts[0].gap == pytest.approx(wanted, abs=1e-15)
    assert maximum(MPI.COMM_WORLD, np.abs(wanted - nodal)) > 1e-4


BALL = {"centre": [0.0, 204.74], "radius": 134.82}


@pytest.mark.parametrize(
    "obstacle",
    [
        {"foundation": {"sphere": BALL, "motion": [0.0, "-0.028*sin(pi*t)"]}},
        {"gap": "-0.028*sin(pi*t)"},
    ],
)
def test_an_obstacle_that_is_back_where_it_touched_presses_nothing(obstacle: Any) -> None:
    """At t = 1 sin(pi*t) is 1e-16 and the distance from the ball 1e-14: both are rounding."""
    parameters = from_mapping(
        {
            "mesh": {"builder": "block", "dim": 2, "size": [93.311, 69.92], "h": 31.2},
            "material": {"elasticity": {"young": 2.1e5, "poisson": 0.45}},
            "loads": {"displacements": [{"on": "bottom", "value": [0.0, 0.0]}]},
            "contact": {"on": "top"} | obstacle,
            "friction": {"coefficient": 0.5},
            "penalty": {"n": math.inf},
            "steps": {"times": [0.5, 1.0]},
        }
    )
    pressed, back = all_of(parameters)
    assert pressed.summary["contact_force"][1] < 0.0
    assert back.summary["contact_force"] == [0.0, 0.0]
    assert maximum(MPI.COMM_WORLD, np.abs(back.displacement.x.array)) == 0.0


def test_nodes_become_free_when_the_normal_of_a_tool_turns() -> None:
    """On the left the vertical displacement is held: all of the normal, until the tool turns."""
    held = [{"on": "left", "value": [None, 0.0]}, {"on": "top", "value": [0.0, 0.0]}]
    plane = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    turn = {"translation": [0.0, "0.015*t"], "rotation": "0.02*t", "about": [1.0, 0.0]}

    def last(times: list[float]) -> tuple[StudySolution, StudySolution]:
        contact = {"on": "bottom", "foundation": plane | {"motion": turn}}
        loads = {"displacements": held}
        steps = {"times": times}
        found = all_of(pressed(2, math.inf, [], None, contact=contact, loads=loads, steps=steps))
        return found[0], found[-1]

    (_, directly), (first, later) = last([1.0]), last([0.0, 1.0])
    free = [int(MPI.COMM_WORLD.allreduce(int(s.contacts[0].free.sum()))) for s in (first, later)]
    assert free[1] == free[0] + 1
    difference = directly.displacement.x.array - later.displacement.x.array
    assert np.abs(difference).max(initial=0.0) < 1e-9
    assert later.summary["friction_force"] == pytest.approx(
        directly.summary["friction_force"], abs=1e-9
    )
    assert abs(later.summary["friction_force"][0]) > 1e-4


@pytest.mark.slow
def test_a_process_with_a_tool_goes_on_from_a_saved_step(tmp_path: Path) -> None:
    folder = Path(MPI.COMM_WORLD.bcast(tmp_path)) / "step"
    disc = {
        "sphere": {"centre": [0.4, -1.0], "radius": 1.0},
        "motion": ["0.3*t", "0.03*min(3*t, 1)"],
    }
    contact = {"on": "bottom", "foundation": disc}
    given: dict[str, Any] = {"contact": contact}

    def parameters(count: int) -> Parameters:
        times = [0.2, 0.4, 0.6, 0.7][:count]
        return pressed(2, math.inf, [0, 0], None, **given, steps={"times": times})

    straight = all_of(parameters(4))
    save(all_of(parameters(2))[-1], folder)
    later = list(solve_steps(parameters(4), restart=folder))
    assert later[0].time == 0.4 and later[-1].time == 0.7
    difference = straight[-1].displacement.x.array - later[-1].displacement.x.array
    assert np.abs(difference).max() < 1e-9
    assert later[-1].history.last("dissipated_total") == pytest.approx(
        straight[-1].history.last("dissipated_total"), rel=1e-6
    )


def test_a_body_that_two_tools_push_to_a_place_between_them_bears_nothing() -> None:
    """Many places are right, as nothing presses the body; every one is without a force."""
    below = {"on": "bottom", "foundation": {"sphere": {"centre": [0.5, -1.0], "radius": 1.0}}}
    ball = {"sphere": {"centre": [0.4, 2.002], "radius": 1.0}, "motion": [0.0, "-1e-4*t"]}
    given = block(
        h=0.5,
        loads={"supports": [{"on": "left", "along": [1, -0.004], "value": "-1e-5*t"}]},
        contact=[below, {"on": "top", "foundation": ball}],
        material__locking_limit=math.inf,
        friction={"coefficient": 0.5, "smoothing": {"kernel": "helmholtz", "radius": 0.6}},
        penalty__n=math.inf,
        steps={"to": 1.0, "count": 2},
    )
    for found in solve_steps(given):
        assert found.converged, found.summary["reason"]
        for entry in found.summary["contacts"]:
            assert entry["contact_force"] == entry["friction_force"] == [0.0, 0.0]


def test_a_locked_body_that_two_tools_leave_no_room_is_proved_to_have_none() -> None:
    """The nodes that the round tool does not reach have a pressure of zero in the proof as well."""
    below = {"on": "bottom", "foundation": {"sphere": {"centre": [0.0, -4.0], "radius": 4.0}}}
    plane = {"point": [0.0, 2.0], "normal": [0.0, -1.0]}
    above = {"on": "top", "foundation": {"half_space": plane, "motion": [0.0, -4e-4]}}
    given = block(
        mesh__size=[1.0, 2.0],
        mesh__h=0.4,
        mesh__axisymmetric=True,
        loads={"supports": [{"on": "right", "along": "normal"}]},
        contact=[below, above],
        material__locking_limit=1e-4,
        friction__coefficient=0.0,
        penalty__n=math.inf,
    )
    reason = solve(given).summary["reason"]
    assert reason.startswith("infeasible"), reason
    assert "the foundation is in the way" in reason
