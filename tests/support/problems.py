"""Parameter sets that several tests share."""

from __future__ import annotations

import math
from typing import Any

import pytest
from mpi4py import MPI

from contact_locking import Parameters, StudySolution, solve, solve_steps
from contact_locking.study_file import from_mapping

SMALL_BLOCK = """\
mesh: {builder: block, h: 0.25}
material:
  locking_limit: 0.05
loads:
  tractions: [{on: top, value: [0.03, -0.05]}]
  displacements: [{on: left, value: [0, 0]}]
contact: {on: bottom}
friction: {coefficient: 0.3, smoothing: {radius: 0.3}}
penalty: {n: 100}
"""
UNDRAWN_BLOCK = f"title: A small block\n{SMALL_BLOCK}output: {{picture: false}}\n"


def block(dim: int = 2, h: float = 0.1, **changes: Any) -> Parameters:
    """The model case: a unit block, clamped on the left, pulled and pressed onto its foundation.

    ``changes`` are dotted keys with dots written as double underscores.
    """
    pull = [0.03, -0.05] if dim == 2 else [0.03, 0.0, -0.05]
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": dim, "size": [1.0] * dim, "h": h},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
        "loads": {
            "tractions": [{"on": "top", "value": pull}],
            "displacements": [{"on": "left", "value": [0.0] * dim}],
        },
        "contact": {"on": "bottom"},
        "friction": {
            "coefficient": 0.3,
            "smoothing": {"kernel": "convolution", "radius": max(0.1, h)},
        },
        "penalty": {"n": 1e3},
    }
    return with_changes(data, **changes)


def solved(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> StudySolution:
    found = solve(parameters, comm)
    assert found.converged, found.summary["reason"]
    return found


def under_a_plate(down: float, **changes: Any) -> Parameters:
    """A block between its foundation and a plate that is glued to its top."""
    plate = {"displacements": [{"on": "top", "value": [0.0, -down]}]}
    return block(loads=plate, **changes)


def column(dim: int = 2, pressure: float = 0.05, **changes: Any) -> Parameters:
    """V1: a column of height 2 between rollers, pressed onto a foundation at a gap of 0.1."""
    rollers = [{"on": ["left", "right"], "value": [0.0] + [None] * (dim - 1)}]
    if dim == 3:
        rollers.append({"on": ["front", "back"], "value": [None, 0.0, None]})
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": dim, "size": [1.0] * (dim - 1) + [2.0], "h": 0.5},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
        "loads": {
            "tractions": [{"on": "top", "value": [0.0] * (dim - 1) + [-pressure]}],
            "displacements": rollers,
        },
        "contact": {"on": "bottom", "gap": 0.1},
        "penalty": {"n": 1e3, "epsilon": 1e-4},
    }
    return with_changes(data, **changes)


def with_changes(data: dict[str, Any], **changes: Any) -> Parameters:
    """Parameters of ``data`` with dotted keys (dots as ``__``) replaced."""
    for key, value in changes.items():
        *path, last = key.split("__")
        place = data
        for name in path:
            place = place.setdefault(name, {})
        place[last] = value
    return Parameters.model_validate(data)


def rollers_of(dim: int, axisymmetric: bool) -> list[dict[str, Any]]:
    """Conditions under which a block is free to expand away from its lower left corner."""
    rollers: list[dict[str, Any]] = [{"on": "bottom", "value": [None] * (dim - 1) + [0.0]}]
    if not axisymmetric:
        rollers.append({"on": "left", "value": [0.0] + [None] * (dim - 1)})
    if dim == 3:
        rollers.append({"on": "front", "value": [None, 0.0, None]})
    return rollers


def benchmark(divisions: int, **changes: Any) -> Parameters:
    """The model case on the regular grid with the larger error, with a proved bound."""
    loads = {
        "tractions": [{"on": "top", "value": [-0.03, -0.05]}],
        "displacements": [{"on": "right", "value": [0.0, 0.0]}],
    }
    changes = {"penalty__n": math.inf, "material__locking_limit": 0.05, "loads": loads} | changes
    return block(
        2, 1.0 / divisions, mesh__structured=True, certificate__error_bound=True, **changes
    )


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


NONE = {"kernel": "none"}
HELD = [{"on": "bottom", "value": [0.0, 0.0]}]
UP = {"point": [0.0, 1.0], "normal": [0.0, -1.0]}


def tool(force: list[Any], on: str = "top", mu: float = 0.3, **shape: Any) -> dict[str, Any]:
    """A contact whose foundation, by default a plane above a unit block, is pushed by a force."""
    friction = {"coefficient": mu, "smoothing": NONE}
    return {
        "on": on,
        "foundation": {**(shape or {"half_space": UP}), "force": force},
        "friction": friction,
    }


def pressed(contact: Any, n: float = math.inf, **changes: Any) -> Parameters:
    """A unit block that stands on its clamped bottom, with a load on its right."""
    loads = {"tractions": [{"on": "right", "value": [-0.01, 0.003]}], "displacements": HELD}
    given: dict[str, Any] = {"h": 0.34, "loads": loads, "penalty__n": n, "contact": contact}
    return block(**(given | changes))


def told(solution: StudySolution, number: int = 0) -> dict[str, Any]:
    """The entry of the summary about a tool."""
    return dict(solution.summary["contacts"][number]["tool"])


def floor(**motion: Any) -> dict[str, Any]:
    """The half space on which a ring stands."""
    return {"half_space": {"point": [0.0, -2.0], "normal": [0.0, 1.0]}} | motion


def ring(way: list[Any], foundation: dict[str, Any], **changes: Any) -> Parameters:
    """The hole is moved by ``way``."""
    return from_mapping(
        {
            "mesh": {"builder": "annulus", "h": 0.3},
            "material": {"locking_limit": 0.06},
            "loads": {"displacements": [{"on": "inner", "value": way}]},
            "contact": {"on": "outer", "foundation": foundation},
            "friction": {"coefficient": 0.3},
            "output": {"picture": False},
        }
        | changes
    )


_GROOVE = [[25, 0], [14, 0], [13, -1.5], [7, -1.5], [6, 0], [-5, 0]]
_RUBBER = {"elasticity": {"young": 5.0, "poisson": 0.45}, "locking_limit": 0.2}


def seal(motion: str = "-0.8*t", **sections: Any) -> Parameters:
    """The strip, 8 high, under a plate with this motion downwards."""
    plate = {"half_space": {"point": [0, 8], "normal": [0, -1]}, "motion": [0, motion]}
    return from_mapping(
        {
            "mesh": {"builder": "block", "size": [20, 8], "h": 2.0},
            "material": _RUBBER,
            "contact": [
                {"on": "bottom", "foundation": {"polyline": _GROOVE}},
                {"on": "top", "name": "plate", "foundation": plate},
            ],
            "friction": {"coefficient": 0.3},
            "steps": {"to": 1, "count": 2},
            **sections,
        }
    )


def two_bodies(on: str, against: str) -> Parameters:
    """The strip under a stiff holder that is pressed down, with the contact of the bodies."""
    return from_mapping(
        {
            "mesh": {"builder": "stack", "size": [20, 8], "upper": [26, 6], "h": 2.0},
            "material": {
                "regions": {
                    "lower": _RUBBER,
                    "upper": {"elasticity": {"young": 2000, "poisson": 0.4}},
                }
            },
            "loads": {"displacements": [{"on": "top", "value": [0, "-0.8*t"]}]},
            "contact": [
                {"on": "bottom", "foundation": {"polyline": _GROOVE}},
                {"on": on, "against": against},
            ],
            "friction": {"coefficient": 0.3},
            "steps": {"to": 1, "count": 1},
        }
    )


SHEARED = ["0.02*sin(2*pi*t)", "-0.02*min(8*t, 1)"]


def sheared(count: int = 8, to: float = 1.0, **changes: Any) -> Parameters:
    """A block that is pressed during an eighth of a cycle, and sheared to and fro all the time."""
    given: dict[str, Any] = {
        "h": 0.25,
        "loads": {"displacements": [{"on": "top", "value": SHEARED}]},
        "steps": {"to": to, "count": count},
        "material__locking_limit": 0.04,
        "penalty__n": math.inf,
    }
    return block(**(given | changes))


def all_of(parameters: Parameters) -> list[StudySolution]:
    solutions = list(solve_steps(parameters))
    assert all(found.converged for found in solutions), solutions[-1].summary["reason"]
    return solutions


ELASTIC = {"young": 1.0, "poisson": 0.3}
SEVERAL: list[dict[str, Any]] = [
    {"norm": "strain", "at_most": 0.02},
    {"norm": "deviator", "at_most": "0.016 + 0.002*x"},
    {"norm": "volume", "at_least": "-0.008 - 0.001*y", "at_most": 0.006},
    {"norm": "direction", "along": ["cos(x)", "sin(x)"], "at_most": 0.007},
    {"norm": "weighted", "matrix": [[2, 0, 0.2], [0, 1, 0], ["0.1*x", 0, 1.5]], "at_most": 0.03},
]


def material(*limits: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"elasticity": ELASTIC, "locking": list(limits), **more}
