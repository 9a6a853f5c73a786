"""V24: Hertz's line contact by force control and by displacement control is one state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from slow import slow
from verification_table import Rows

from contact_locking import Parameters, StudySolution
from contact_locking.mesh.domain import Domain
from contact_locking.running import solving
from contact_locking.study.assembly import assemble

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
