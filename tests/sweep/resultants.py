"""Whether forces that press and rub can balance the loads of a block that little else holds.

An argument from the parameters: pressures p >= 0 and tractions |sigma_tau| <= mu |R p| at the nodes
of the foundation, and forces of any size along the direction of a support on the left, have three
resultants, which balance those of the loads.  It is a linear programme
that knows neither displacement nor material.  Only R is the program's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI
from scipy.optimize import linprog

from contact_locking.arrays import FloatArray
from contact_locking.expressions import parse
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters

from .case import Study

# The share of the loads that must be left unbalanced for certain.
_CERTAIN = 1e-3
# A force that is a smaller share of the largest is zero.
_ROUNDING = 1e-12


def cannot_balance(study: Study, time: float) -> bool:
    """Whether no forces of foundation and supports balance the tractions at a time.

    False for anything but a plane block on one foundation with tractions on top and right, and with
    supports on the left.  A tool whose force has fallen to zero presses nothing.
    """
    mesh, loads, contacts = study["mesh"], study["loads"], study["contact"]
    if "tractions" not in loads or not set(loads) <= {"tractions", "supports"}:
        return False
    parameters = Parameters.model_validate(study)
    pressing = [i for i, item in enumerate(contacts) if not _is_let_go(item, time, parameters)]
    if len(pressing) != 1 or contacts[pressing[0]]["on"] != "bottom" or mesh.get("axisymmetric"):
        return False
    (place,) = pressing
    width, height = mesh["size"]
    supported = _supported(loads.get("supports", []))
    sides = {
        "top": (width, np.array([0.5 * width, height])),
        "right": (height, np.array([width, 0.5 * height])),
    }
    load: FloatArray = np.zeros(3)
    size = 0.0
    for traction in loads["tractions"]:
        length, centre = sides[traction["on"]]
        value = _vector(traction["value"], time)[None, :]
        force = _resultants(value * length, centre[None, :] / height)[:, 0]
        load, size = load + force, size + float(np.abs(force).max())
    contact = assemble(parameters, MPI.COMM_SELF).contacts[place]
    points = contact.surface.points[:, :2]
    count = len(points)
    normals = _normals(contacts[place], points)
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    smoothing = np.column_stack([contact.friction.smoothing.apply(row) for row in np.eye(count)])
    # The unknowns: forces along the normals (which press the body the other way) and along the
    # tangents at the nodes, forces of the supports at both ends of the left side, which stand for
    # those between, and what is left of the three resultants, either way.
    weights = _weights(points[:, 0])
    balance = np.hstack(
        [
            _resultants(-normals, points / height),
            _resultants(tangents, points / height),
            _resultants(supported, np.tile([[0.0, 0.0], [0.0, 1.0]], (len(supported) // 2, 1))),
            np.eye(3),
            -np.eye(3),
        ]
    )
    taken = study["friction"]["coefficient"] * weights[:, None] * smoothing / weights[None, :]
    free = count + len(supported)
    rest = np.zeros((count, len(supported) + 6))
    found = linprog(
        np.append(np.zeros(count + free), np.ones(6)),
        A_ub=np.vstack([np.hstack([-taken, sign * np.eye(count), rest]) for sign in (1.0, -1.0)]),
        b_ub=np.zeros(2 * count),
        A_eq=balance,
        b_eq=-load / max(size, 1e-300),
        bounds=[(0, None)] * count + [(None, None)] * free + [(0, None)] * 6,
    )
    return bool(found.status == 0 and found.fun > _CERTAIN)


def _is_let_go(contact: Study, time: float, parameters: Parameters) -> bool:
    """Whether the foundation is a tool without a force, but for the rounding of a sine."""
    force = contact.get("foundation", {}).get("force")
    if force is None or parameters.steps is None:
        return False
    largest = max(np.abs(_vector(force, planned)).max() for planned in parameters.steps.planned)
    return bool(np.abs(_vector(force, time)).max() <= _ROUNDING * largest)


def _vector(components: Sequence[str | float], time: float) -> FloatArray:
    """Expressions of t at a time."""
    return np.array([float(parse(str(part), ("t",)).numpy(t=time)) for part in components])


def _resultants(forces: FloatArray, places: FloatArray) -> FloatArray:
    """The force and the moment (3, k) of forces (k, 2)."""
    moment = places[:, 0] * forces[:, 1] - places[:, 1] * forces[:, 0]
    return np.vstack([forces.T, moment])


def _supported(supports: list[Study]) -> FloatArray:
    """The direction of each support on the left, twice."""
    assert all(support["on"] == "left" for support in supports)
    along = [
        [1.0, 0.0] if support["along"] == "normal" else support["along"] for support in supports
    ]
    return np.repeat(np.array(along, dtype=float).reshape(-1, 2), 2, axis=0)


def _normals(contact: Study, points: FloatArray) -> FloatArray:
    """The unit vectors from the points towards the foundation below."""
    shape = contact.get("foundation", {})
    down = np.tile([0.0, -1.0], (len(points), 1))
    if "half_space" in shape:
        down = np.tile(-np.array(shape["half_space"]["normal"]), (len(points), 1))
    elif "sphere" in shape:
        down = np.array(shape["sphere"]["centre"]) - points
    return np.asarray(down / np.linalg.norm(down, axis=1)[:, None])


def _weights(x: FloatArray) -> FloatArray:
    """The lengths that belong to points of a line, in any order."""
    order = np.argsort(x)
    half = 0.5 * np.diff(x[order])
    weights = np.empty_like(x)
    weights[order] = np.append(half, 0.0) + np.append(0.0, half)
    return weights
