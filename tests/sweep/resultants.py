"""Whether forces that press and rub can balance the loads of a body that little else holds.

Pressures p >= 0 and tractions |sigma_tau| <= mu |R p| at the nodes of the foundations, and forces
of any size along what conditions hold, have three resultants, which balance those of the loads.  It
is a linear programme that knows neither displacement nor material.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linprog

from .contact import Contact
from .elements import Array, value
from .judge import Judge

# The share of the loads that must be left unbalanced for certain.
_CERTAIN = 1e-3
# A force that is a smaller share of the largest is zero.
_ROUNDING = 1e-12


def cannot_balance(judge: Judge, time: float) -> bool:
    """Whether no forces of foundations and conditions balance the loads on a plane body at a time.

    A tool whose force has fallen to zero presses nothing.
    """
    body = judge.body
    height = float(np.ptp(judge.mesh.x[:, 1]))
    x = np.asarray(judge.mesh.x / height)
    if judge.mesh.axisymmetric or body.dim != 2:
        return False
    columns = [_resultants(ways, x[nodes]) for nodes, ways, _ in body.held(time)]
    held = sum(part.shape[1] for part in columns)
    # Forces of conditions, pressures and tractions in turn, and what is left, either way.
    bounds: list[tuple[float | None, None]] = [(None, None)] * held
    limits = []
    for contact in judge.contacts:
        if _is_let_go(judge, contact, time):
            continue
        normals, _ = contact.normals_and_gap(time)
        tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
        columns += [_resultants(way, x[contact.nodes]) for way in (-normals, tangents)]
        weights, count = contact.weights, len(contact.nodes)
        R = contact.smoothing(normals, contact.decides(normals))
        mu = value(contact.friction["coefficient"], contact.x, s=np.zeros(count))
        taken = (mu * weights)[:, None] * R / weights
        limits.append(np.block([[-taken, np.eye(count)], [-taken, -np.eye(count)]]))
        bounds += [(0, None)] * count + [(None, None)] * count
    columns += [np.eye(3), -np.eye(3)]
    loads = body.loads(time)
    load = _resultants(loads, x).sum(axis=1)
    size = float(np.abs(loads).sum(axis=0).max())
    limit = sp.block_diag([np.zeros((0, held)), *limits, np.zeros((0, 6))], "csr")
    found = linprog(
        np.append(np.zeros(len(bounds)), np.ones(6)),
        A_ub=limit if limits else None,
        b_ub=np.zeros(limit.shape[0]) if limits else None,
        A_eq=np.hstack(columns),
        b_eq=-load / max(size, 1e-300),
        bounds=bounds + [(0, None)] * 6,
    )
    return bool(found.status == 0 and found.fun > _CERTAIN)


def _is_let_go(judge: Judge, contact: Contact, time: float) -> bool:
    """Whether the foundation is a tool without a force, but for the rounding of a sine."""
    steps = judge.study.get("steps")
    if "force" not in (contact.section.get("foundation") or {}) or not steps:
        return False
    count = steps.get("count", 1)
    planned = steps.get("times") or [steps["to"] * (k + 1) / count for k in range(count)]
    return contact.strongest([time]) <= _ROUNDING * contact.strongest(planned)


def _resultants(forces: Array, places: Array) -> Array:
    """The force and the moment (3, k) of forces (k, 2)."""
    moment = places[:, 0] * forces[:, 1] - places[:, 1] * forces[:, 0]
    return np.vstack([forces.T, moment])
