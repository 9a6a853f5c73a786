"""V51, V52: foundations on springs, and foundations that turn, beside closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pressed_tools import NONE, pressed, solved, told
from problems import column
from slow import slow
from verification_table import Row

from contact_locking import Parameters
from contact_locking.arrays import FloatArray
from contact_locking.study_file import from_mapping

TEST = "test_verification_free_foundations.py"
LAWS = [(math.inf, "auto"), (1e3, "newton"), (1e3, "interior_point")]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("n", "method"), LAWS)
@pytest.mark.parametrize("preload", [0.0, 0.01])
def test_a_spring_and_a_column_are_two_springs_in_series(
    dim: int, n: float, method: str, preload: float, found: list[Row]
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
    found.append(Row("V51", where, "travel", told(state)["travel"], travel, TEST))
    assert told(state)["travel"] == pytest.approx(travel, rel=1e-8)
    assert told(state)["spring_force"] == pytest.approx(-k * travel, rel=1e-8)
    assert state.summary["contact_force"][-1] == pytest.approx(k * travel - preload, rel=1e-8)
    assert state.summary["certificate"]["criteria"]["tool_balance"]["holds"]


def strips(dim: int, at: float, n: float, method: str, **changes: Any) -> Parameters:
    """A block of strips without shear stiffness, which a plate presses at a point of its top."""
    sizes = 3 if dim == 2 else 6
    stiffness = np.diag([1.0] * dim + [1e-6] * (sizes - dim)).tolist()
    up = [0.0] * (dim - 1) + [1.0]
    down = [-x for x in up]
    foundation = {
        "half_space": {"point": up, "normal": down},
        "force": [0.01 * x for x in down],
        "tilt": {"about": [at, *[1.0 - at] * (dim - 2), 1.0]},
    }
    mesh = {"builder": "block", "dim": dim, "size": [1.0] * dim, "h": 0.25}
    return from_mapping(
        {
            "mesh": mesh | {"cells": "box", "structured": True},
            "material": {"elasticity": {"stiffness": stiffness}, "locking_limit": math.inf},
            "loads": {"displacements": [{"on": "bottom", "value": [0.0] * dim}]},
            "contact": {"on": "top", "foundation": foundation},
            "penalty": {"n": n, "epsilon": 1e-6},
            "solver": {"method": method},
        }
        | changes
    )


@pytest.mark.parametrize(
    ("dim", "n", "method"),
    [
        *((2, *law) for law in LAWS[:2]),
        (3, *LAWS[0]),
        slow(2, *LAWS[2]),
        *(slow(3, *law) for law in LAWS[1:]),
    ],
)
def test_an_eccentric_force_tilts_a_plate_as_a_linear_pressure_says(
    dim: int, n: float, method: str, found: list[Row]
) -> None:
    """``p = F (1 + 12 e (x - 1/2))`` on strips of unit stiffness, for ``e < 1/6`` in 2D."""
    eccentric = 0.1 if dim == 2 else 0.05
    state = solved(strips(dim, 0.5 + eccentric, n, method))
    angle = 0.01 * 12.0 * eccentric
    tilt = state.summary["contacts"][0]["tilt"]
    wanted = [-angle] if dim == 2 else [angle, angle, 0.0]
    angles = np.atleast_1d(tilt["angle"])
    where = f"plate on strips, {dim}D, n = {n:g}, {method}"
    found.append(Row("V52", where, "angle", float(angles[0]), wanted[0], TEST))
    assert angles == pytest.approx(wanted, rel=1e-5, abs=1e-12)
    deepest = 0.01 + (dim - 1) * angle * eccentric
    found.append(Row("V52", where, "travel", told(state)["travel"], deepest, TEST))
    assert told(state)["travel"] == pytest.approx(deepest, rel=1e-5)
    if state.contact_points is not None:
        places, pressure = state.contact_points.x[:, :-1], state.contact_points.pressure
        forces = pressure * _trapezia(places)
        moments = forces @ (places - tilt["about"][:-1])
        assert np.abs(moments).max() <= 1e-7 * forces.sum()


def _trapezia(places: FloatArray) -> FloatArray:
    """The weights of nodes of the unit interval or square at distances of 1/4."""
    ends = np.isclose(places, 0.0) | np.isclose(places, 1.0)
    return np.asarray(np.prod(np.where(ends, 0.125, 0.25), axis=1))


def test_a_plate_follows_a_stiff_block_on_springs_of_two_stiffnesses(found: list[Row]) -> None:
    """Force and moment of springs that the halves of the bottom have, of a block without strain."""
    soft, firm, at, force = 1.0, 3.0, 0.6, 0.01
    foundation = {
        "half_space": {"point": [0.0, 1.0], "normal": [0.0, -1.0]},
        "force": [0.0, -force],
        "tilt": {"about": [at, 1.0]},
    }
    plate = {
        "on": "top",
        "foundation": foundation,
        "friction": {"coefficient": 0.0, "smoothing": NONE},
    }
    state = solved(
        pressed(
            plate,
            loads={
                "springs": [{"on": "bottom", "stiffness": f"{soft} if x < 0.5 else {firm}"}],
            },
            material={"elasticity": {"young": 1e7, "poisson": 0.0}, "locking_limit": math.inf},
            mesh={"builder": "block", "size": [1.0, 1.0], "h": 0.25, "structured": True},
        )
    )
    # int k (a + b x) = F and int k (a + b x) x = F at, where a + b x is the settlement.
    moments = [(soft + firm * (2.0 ** (i + 1) - 1.0)) / (i + 1) / 2.0 ** (i + 1) for i in range(3)]
    a, b = np.linalg.solve([moments[:2], moments[1:]], [force, force * at])
    angle, travel = state.summary["contacts"][0]["tilt"]["angle"], told(state)["travel"]
    where = "stiff block on springs of two stiffnesses"
    found.append(Row("V52", where, "angle", angle, -b, TEST))
    found.append(Row("V52", where, "travel", travel, a + b * at, TEST))
    assert angle == pytest.approx(-b, rel=1e-4)
    assert travel == pytest.approx(a + b * at, rel=1e-4)


def test_a_plate_lifts_off_where_the_force_is_far_from_the_middle(found: list[Row]) -> None:
    """The pressure of strips is a triangle of the length ``3 (1/2 - e)`` for ``e > 1/6``."""
    fine = strips(2, 0.8, math.inf, "auto")
    mesh = fine.model_dump(exclude_unset=True)["mesh"] | {"h": 1.0 / 64.0}
    state = solved(strips(2, 0.8, math.inf, "auto", mesh=mesh))
    area, angle = state.summary["contact_area"], state.summary["contacts"][0]["tilt"]["angle"]
    # F = angle length^2/2
    wanted = -0.01 * 2.0 / 0.6**2
    where = "plate that lifts off strips, h = 1/64"
    found.append(Row("V52", where, "contact area", area, 0.6, TEST))
    found.append(Row("V52", where, "angle", angle, wanted, TEST))
    assert area == pytest.approx(0.6, abs=0.02)
    assert angle == pytest.approx(wanted, rel=0.02)
