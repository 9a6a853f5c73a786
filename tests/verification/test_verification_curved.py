"""Contact of bodies whose curved boundary is made of chords, with a foundation that follows it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from verification_table import Row

from contact_locking import StudySolution, solve
from contact_locking.study_file import from_mapping

TEST = "test_verification_curved.py"
PRESS, NU = 0.01, 0.3
# Lame's pressure on a ring of the radii 1 and 2, E = 1, that is pressed inwards by PRESS.
LAME = PRESS / (2.0 * (1.0 - NU**2) * (5.0 / 3.0 - NU / (1.0 - NU)))


def solved(data: dict[str, Any]) -> StudySolution:
    solution = solve(
        from_mapping(
            data
            | {"material": {"elasticity": {"young": 1.0, "poisson": NU}}}
            | {"output": {"picture": False}}
        )
    )
    assert solution.converged, solution.summary["reason"]
    assert solution.summary["warnings"] == []
    return solution


def pressures(solution: StudySolution) -> Any:
    return np.concatenate(MPI.COMM_WORLD.allgather(solution.contacts[0].pressure))


@pytest.mark.parametrize(("degree", "scatter"), [(1, 0.01), (2, 0.003)])
def test_a_ring_in_a_rigid_ring_has_the_pressure_of_lame_at_every_node(
    degree: int, scatter: float, found: list[Row]
) -> None:
    pressure = pressures(
        solved(
            {
                "mesh": {"builder": "annulus", "h": 0.2, "quarter": True},
                "loads": {
                    "displacements": [
                        {"on": "bottom", "value": [None, 0]},
                        {"on": "left", "value": [0, None]},
                    ]
                },
                "contact": {
                    "on": "outer",
                    "foundation": {"expression": f"{2.0 - PRESS} - sqrt(x**2 + y**2)"},
                },
                "discretisation": {"degree": degree},
            }
        )
    )
    where = f"ring in a rigid ring, degree {degree}, h = 0.2"
    found.append(Row("V28", where, "mean pressure", float(np.mean(pressure)), LAME, TEST))
    share = float(np.std(pressure)) / LAME
    found.append(Row("V28", where, "scatter of the pressure", share, None, TEST))
    assert share < scatter
    assert np.mean(pressure) == pytest.approx(LAME, rel=0.015)


def test_a_flat_body_with_quadratic_displacements_has_straight_edges() -> None:
    tool = {"sphere": {"centre": [0.5, -5.0], "radius": 5.0}}
    top = {"displacements": [{"on": "top", "value": [0.0, -0.01]}]}
    block = {"builder": "block", "size": [1, 1], "h": 0.25}
    whole_skin = {"on": ["bottom", "left", "right"], "foundation": tool}
    solution = solved(
        {"mesh": block, "loads": top, "contact": whole_skin, "discretisation": {"degree": 2}}
    )
    surface = solution.contacts[0].surface
    assert surface.places == pytest.approx(surface.points, abs=1e-12)
