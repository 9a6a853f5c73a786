"""Parameter sets that several tests share."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from contact_locking import StudySolution, solve
from contact_locking.study_file.parameters import Parameters

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
