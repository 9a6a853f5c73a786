"""Gamma_C may be the whole skin of a body, of which only a part faces the foundation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from problems import block, floor, ring, solved
from slow import slow

from contact_locking import Parameters, solve
from contact_locking.errors import Misplaced


def roller(foundation: dict[str, Any]) -> Parameters:
    mesh = {"builder": "annulus", "h": 0.25}
    return ring([0.02, -0.05], foundation, mesh=mesh)


@pytest.mark.parametrize(
    ("foundation", "same"),
    [
        (floor(), "y + 2"),
        slow({"sphere": {"centre": [0.0, -6.0], "radius": 4.0}}, "sqrt(x**2 + (y + 6)**2) - 4"),
    ],
)
def test_a_ring_on_a_foundation_touches_where_it_faces_it(
    foundation: dict[str, Any], same: str
) -> None:
    found = solved(roller(foundation))
    contact, friction = (np.array(found.summary[k]) for k in ("contact_force", "friction_force"))
    assert contact[1] > 0.0 and friction[0] < 0.0
    held = np.array(found.summary["reactions"]["inner"])
    np.testing.assert_allclose(contact + friction + held, 0.0, atol=1e-6 * contact[1])
    points = found.contact_points
    if points is not None:
        assert points.x[:, 1].max() > 1.9
        assert np.all(points.pressure[points.x[:, 1] > -1.5] < 1e-6 * points.pressure.max())
    other = solved(roller({"expression": same}))
    np.testing.assert_allclose(
        found.displacement.x.array, other.displacement.x.array, rtol=0.0, atol=1e-8
    )


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
def test_sides_that_stand_on_the_foundation_change_nothing(dim: int) -> None:
    """In the variational inequality the nodes at the edge have the same condition."""
    ground = {"half_space": {"point": [0.0] * dim, "normal": [*[0.0] * (dim - 1), 1.0]}}
    found = [
        solved(
            block(
                dim,
                h=0.25,
                contact={"on": names, "foundation": ground},
                friction__coefficient=0.0,
                penalty__n=math.inf,
            )
        )
        for names in (["bottom"], ["bottom", "right"])
    ]
    assert found[0].summary["contact_area"] > 0.0
    np.testing.assert_allclose(
        found[0].displacement.x.array, found[1].displacement.x.array, rtol=0.0, atol=1e-8
    )


def test_a_foundation_that_nothing_faces_is_refused() -> None:
    ground = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    with pytest.raises(Misplaced, match=r"the foundation lies behind contact\.on"):
        solve(block(2, h=0.5, contact={"on": "top", "foundation": ground}))
    upside_down = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, -1.0]}}
    with pytest.raises(Misplaced, match="turn the normal of the half space"):
        solve(block(2, h=0.5, contact={"on": "bottom", "foundation": upside_down}))
