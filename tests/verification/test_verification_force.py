"""V24 and V51: foundations under a force, beside given displacements, and on springs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import NONE, column, solved, told
from slow import slow
from verification_table import Rows

from contact_locking import Parameters, StudySolution
from contact_locking.mesh.domain import Domain
from contact_locking.running import solving
from contact_locking.running.assembly import assemble

# A force of 10 presses a cylinder of radius 8, as its lower half, onto a plane (V6).
FORCE, HALF_WIDTH, PEAK = 10.0, 0.681, 9.35


def pressed_cylinder(
    down: float, n: float, domain: Domain | None = None, **foundation: Any
) -> StudySolution:
    """The cylinder whose top moves down onto a plane, which a force may push.

    Two solutions are comparable on several ranks only on one ``domain``, as two meshes are not
    distributed alike.
    """
    plane = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}, **foundation}
    mesh = {"builder": "disc", "radius": 8.0, "h": 2.0, "h_contact": 0.1, "contact_width": 1.5}
    parameters = Parameters.model_validate(
        {
            "mesh": mesh,
            "material": {
                "elasticity": {"young": 200.0, "poisson": 0.3},
                "locking_limit": 0.05,
            },
            "loads": {"displacements": [{"on": "top", "value": [0.0, -down]}]},
            "contact": {"on": "contact", "foundation": plane},
            "friction": {"coefficient": 0.3, "smoothing": {"kernel": "none"}},
            "penalty": {"n": n},
        }
    )
    return solving.solve_assembled(assemble(parameters, MPI.COMM_WORLD, domain))


@pytest.mark.parametrize("n", [slow(1e5), math.inf])
def test_v24_the_force_that_came_out_gives_the_same_state(n: float, found: Rows) -> None:
    pushed = pressed_cylinder(0.0, n, force=[0.0, FORCE])
    assert pushed.converged, pushed.summary["reason"]
    travel = pushed.summary["contacts"][0]["tool"]["travel"]
    moved = pressed_cylinder(travel, n, pushed.domain)
    assert moved.converged, moved.summary["reason"]
    force = moved.summary["contact_force"][1]
    # The cylinder has moved down instead of the plane up.
    down = np.array([0.0, travel])
    u = pushed.displacement.x.array.reshape(-1, 2)
    w = moved.displacement.x.array.reshape(-1, 2) + down
    comm = pushed.domain.comm
    distance = max(comm.allgather(float(np.abs(u - w).max(initial=0.0)))) / travel
    problem = f"cylinder by force and by displacement, n = {n:g}"
    half = pushed.summary["contact_area"] / 2.0
    found.add("V24", problem, "force that came out", force, FORCE, rel=1e-6)
    found.add(
        "V24", problem, "distance of the displacements over the travel", distance, None, abs=1e-6
    )
    found.add("V24", problem, "half-width", half, HALF_WIDTH, rel=0.15)
    if pushed.contact_points is not None and moved.contact_points is not None:
        peaks = [float(one.contact_points.pressure.max()) for one in (pushed, moved)]  # type: ignore[union-attr]
        found.add("V24", problem, "peak pressure", peaks[0], PEAK, rel=0.08)
        assert peaks[0] == pytest.approx(peaks[1], rel=1e-5)


LAWS = [(math.inf, "auto"), (1e3, "interior_point")]


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("n", "method"), LAWS)
@pytest.mark.parametrize("preload", [0.0, 0.01])
def test_a_spring_and_a_column_are_two_springs_in_series(
    dim: int, n: float, method: str, preload: float, found: Rows
) -> None:
    """``p + k q = F`` and ``p = S (raised + q - eps p)/height``."""
    raised, height, k, epsilon = 0.02, 2.0, 0.5, 1e-4
    stiffness = 0.3 / (1.3 * 0.4) + 2.0 / 2.6
    across = [0.0] * (dim - 1)
    spring: dict[str, Any] = {"stiffness": k}
    plane = {"point": [*across, height], "normal": [*across, -1.0]}
    foundation: dict[str, Any] = {"half_space": plane, "spring": spring}
    if preload:
        foundation["force"] = [*across, -preload]
    else:
        spring["along"] = [*across, 7.0]
    rollers = [item.model_dump() for item in column(dim).loads.displacements]
    stands = {"on": ["bottom"], "value": [None] * (dim - 1) + [raised]}
    state = solved(
        column(
            dim,
            contact={"on": "top", "foundation": foundation},
            friction={"coefficient": 0.0, "smoothing": NONE},
            loads={"displacements": [*rollers, stands]},
            material__locking_limit=math.inf,
            penalty={"n": n, "epsilon": epsilon},
            solver__method=method,
        )
    )
    per = stiffness / (height + stiffness * epsilon)
    travel = (preload - per * raised) / (k + per)
    where = f"column and spring, {dim}D, n = {n:g}, {method}, F = {preload:g}"
    found.add("V51", where, "travel", told(state)["travel"], travel, rel=1e-8)
    assert told(state)["spring_force"] == pytest.approx(-k * travel, rel=1e-8)
    assert state.summary["contact_force"][-1] == pytest.approx(k * travel - preload, rel=1e-8)
    assert state.summary["certificate"]["criteria"]["tool_balance"]["holds"]
