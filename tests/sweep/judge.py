"""Whether a solution is one: equilibrium and every law, by sums that share nothing with the solver.

Every law is the optimality of a convex function, so that one number tells how far it is violated:
the work ``phi(a) + phi*(b) - a b >= 0`` of Fenchel, summed over cells or nodes and divided by the
energy of the problem.  Forces are compared in the norm that K^-1 gives them.  No number has a
unit, and each has a floor of what rounding in the displacement makes of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.study_file.parameters import Parameters

from .discrete import Discrete, State, at

# Forces relative to the forces there are, and works relative to the energy there is.
FORCE, WORK = 1e-6, 1e-6
# Strains beyond M, penetration beyond the displacement, tractions beyond their bound.
EXCESS = 1e-6
# The allowed rounding of a sum, in units of the last digit of its terms.
DIGITS = 200.0
_EPS = float(np.finfo(float).eps)
# A displacement that is larger than the largest length of the data by this factor has run away,
# until the rounding in it was larger than the loads.
_FLIGHT = 1e3

Found = dict[str, float]


def violations(parameters: Parameters, discrete: Discrete, state: State) -> Found:
    """The violation of each law in units of its tolerance: a right solution has at most 1."""
    scales = _Scales(discrete, state)
    found = {"equilibrium": _equilibrium(discrete, state, scales)}
    found["prescribed"] = _ratio(
        np.abs(state.u - discrete.prescribed)[~discrete.free].max(initial=0.0),
        1e-13 * np.abs(discrete.prescribed).max(initial=0.0),
    )
    if scales.is_loose:
        found["flight"] = flight(state.u, _lengths(discrete))
    found |= _locking(discrete, state, scales)
    if discrete.contact is not None:
        found |= _contact(discrete, state, scales)
        found |= _friction(parameters, discrete, state, scales)
    return found


def flight(u: FloatArray, lengths: Sequence[FloatArray]) -> float:
    """How far displacements are beyond the lengths of the data, above 1 for a body in flight."""
    finite = (np.abs(values[np.isfinite(values)]) for values in lengths)
    reach = max(float(values.max(initial=0.0)) for values in finite)
    return _ratio(float(np.abs(u).max(initial=0.0)), _FLIGHT * reach)


def _lengths(discrete: Discrete) -> list[FloatArray]:
    """The size of the body, prescribed displacements and gaps."""
    gaps = [] if discrete.contact is None else [discrete.contact.gap]
    return [np.ptp(discrete.geometry.x, axis=0), discrete.prescribed, *gaps]


def complaint(found: Found) -> str:
    """The violated laws, the worst first; "" if no law is violated."""
    worst = sorted(((v, k) for k, v in found.items() if not v <= 1.0), reverse=True)
    return ", ".join(f"{name} {value:.2g}" for value, name in worst)


def asked_for(discrete: Discrete, state: State) -> float:
    """The forces of loads and elasticity, over those of contact, friction and locking."""
    contact, scales = discrete.contact, _Scales(discrete, state)
    assert contact is not None
    force = contact.forces(state.pressure[:, None] * contact.normals - state.traction)
    largest = max(scales.norm(force), scales.norm(discrete.forces(state.locking)))
    return scales.norm(discrete.load - scales.stiffness @ state.u) / largest


class _Scales:
    """Energies, the norm of forces, and what rounding in u makes of both."""

    def __init__(self, discrete: Discrete, state: State) -> None:
        self.stiffness = K = discrete.stiffness
        u = state.u
        absolute = abs(u)
        # Sizes of what the nodal forces are sums of.
        self.internal = abs(K) @ absolute
        locking = np.abs(state.locking) * discrete.volumes[:, None]
        parts = self.internal + discrete.load_size + abs(discrete.strain).T @ locking.ravel()
        self.tractions = np.zeros_like(u)
        if discrete.contact is not None:
            contact = discrete.contact
            size = state.pressure[:, None] * np.abs(contact.normals) + np.abs(state.traction)
            self.tractions += contact.forces(np.abs(size))
        self.rounding = DIGITS * _EPS * (parts + self.tractions)
        strain = np.linalg.norm(discrete.strains(u), axis=1)
        stress = np.linalg.norm(state.locking, axis=1)
        # Where M is infinite there is no locking stress.
        held = np.where(stress > 0.0, np.minimum(discrete.limit, strain), 0.0)
        energies = [
            abs(u @ (K @ u)),
            abs(discrete.load @ u),
            float(discrete.volumes @ (held * stress)),
        ]
        self.energy = max(energies)
        self.energy_floor = DIGITS * _EPS * float(absolute @ (parts + self.tractions))
        self.is_loose = _loose(discrete)
        self._solve = _inverse(discrete, K, self.is_loose)
        self.free = discrete.free

    def norm(self, force: FloatArray) -> float:
        """``sqrt(f . K^-1 f)`` over the free dofs."""
        part = force[self.free]
        return math.sqrt(max(float(part @ self._solve(part)), 0.0))


def _inverse(
    discrete: Discrete, K: sp.csr_matrix, is_loose: bool
) -> Callable[[FloatArray], FloatArray]:
    """A solve with K over the free dofs, scaled; what contact alone holds is made stiff there."""
    diagonal = np.zeros(K.shape[0])
    if discrete.contact is not None and is_loose:
        x = discrete.geometry.x
        stiffness = float(np.median(discrete.law[:, 0, 0])) / float(np.ptp(x, axis=0).max())
        springs = np.full_like(discrete.contact.normals, stiffness)
        diagonal += discrete.contact.forces(springs)
    if not discrete.free.any():
        return lambda f: f
    matrix = (K + sp.diags(diagonal)).tocsr()[discrete.free][:, discrete.free]
    scale = 1.0 / np.sqrt(matrix.diagonal())
    factor = splu((sp.diags(scale) @ matrix @ sp.diags(scale)).tocsc())
    return lambda f: scale * factor.solve(scale * f)


def _loose(discrete: Discrete) -> bool:
    """Whether a rigid motion of a part of the body is left by the prescribed displacements."""
    parts, cells = discrete.geometry.domain.parts, discrete.geometry.cells
    return any(
        _is_loose(discrete, np.unique(cells[parts[: len(cells)] == part]))
        for part in np.unique(parts)
    )


def _is_loose(discrete: Discrete, nodes: npt.NDArray[Any]) -> bool:
    x, dim = discrete.geometry.x[nodes], discrete.dim
    x = (x - x.mean(axis=0)) / np.ptp(x, axis=0).max()
    motions = [np.tile(np.eye(dim)[i], (len(x), 1)) for i in range(dim)]
    for i in range(dim):
        for j in range(i + 1, dim):
            turn = np.zeros_like(x)
            turn[:, i], turn[:, j] = -x[:, j], x[:, i]
            motions.append(turn)
    fixed = ~discrete.free.reshape(-1, dim)[nodes].ravel()
    held = np.array([m.ravel()[fixed] for m in motions]).T
    return bool(np.linalg.matrix_rank(held, tol=1e-6) < len(motions))


def _ratio(value: float, tolerated: float) -> float:
    """The value over what is tolerated, where both may be zero."""
    if math.isnan(value):
        return math.inf
    return 0.0 if value <= 0.0 else float(value / max(tolerated, 1e-300))


def _worst(values: FloatArray, tolerated: FloatArray) -> float:
    """The largest of the ratios."""
    pairs = zip(values, np.broadcast_to(tolerated, values.shape), strict=True)
    return max((_ratio(float(v), float(t)) for v, t in pairs), default=0.0)


def _equilibrium(discrete: Discrete, state: State, scales: _Scales) -> float:
    """``|K u + forces of Z, p and sigma_tau - f|`` over the larger of those."""
    elastic, locking = scales.stiffness @ state.u, discrete.forces(state.locking)
    surface = np.zeros_like(state.u)
    if discrete.contact is not None:
        contact = discrete.contact
        force = state.pressure[:, None] * contact.normals - state.traction
        surface = contact.seen.T @ (contact.weights[:, None] * force).ravel()
    residual = elastic + locking + surface - discrete.load
    parts = [discrete.load, locking, surface]
    size = max(scales.norm(part) for part in parts)
    # The criterion of the energy covers prescribed displacements.
    size = max(size, math.sqrt(abs(float(state.u @ elastic))))
    signs = np.where(np.arange(len(residual)) * 0.618 % 1.0 < 0.5, -1.0, 1.0)
    floor = scales.norm(signs * scales.rounding)
    return _ratio(scales.norm(residual), FORCE * size + floor)


def _locking(discrete: Discrete, state: State, scales: _Scales) -> Found:
    strains = discrete.strains(state.u)
    size, stress = np.linalg.norm(strains, axis=1), np.linalg.norm(state.locking, axis=1)
    limit, n, volumes = discrete.limit, discrete.n, discrete.volumes
    locks = np.isfinite(limit)
    x = discrete.geometry.x
    # Rounding of u in a strain, by the size of the cell.
    edges = np.array([np.ptp(x[cell], axis=0).max() for cell in discrete.geometry.cells])
    edges = np.repeat(edges, len(volumes) // len(edges))
    rounding = 20.0 * _EPS * np.abs(state.u).max(initial=0.0) / edges
    found = {"stress where M is infinite": _ratio(stress[~locks].max(initial=0.0), 0.0)}
    size, stress, limit = size[locks], stress[locks], limit[locks]
    work = limit * stress - np.sum(state.locking * strains, axis=1)[locks]
    if math.isinf(n):
        found["strain beyond M"] = _worst(size - limit, EXCESS * limit + rounding[locks])
    else:
        work += n * np.maximum(size - limit, 0.0) ** 2 + stress**2 / (4.0 * n)
    floor = float(volumes[locks] @ (rounding[locks] * stress)) + scales.energy_floor
    total = float(np.abs(volumes[locks] @ work))
    found["locking law"] = _ratio(total, WORK * scales.energy + floor)
    return found


def _contact(discrete: Discrete, state: State, scales: _Scales) -> Found:
    contact = discrete.contact
    assert contact is not None
    u = contact.of(state.u)
    normal = np.einsum("kd,kd->k", u, contact.normals)
    on, p, w = contact.decides, state.pressure, contact.weights
    depth = (normal - contact.gap)[on]
    p, w = p[on], w[on]
    largest = float(np.abs(state.u).max(initial=0.0))
    rounding = contact.rounding[on] + 8.0 * _EPS * largest
    found = {"pulling pressure": _ratio(-p.min(initial=0.0), EXCESS * np.abs(p).max(initial=0.0))}
    work = -p * depth
    if discrete.epsilon == 0.0:
        found["penetration"] = _worst(depth, EXCESS * largest + rounding)
    else:
        work = work + np.maximum(depth, 0.0) ** 2 / (2.0 * discrete.epsilon)
        work += 0.5 * discrete.epsilon * p**2
    floor = float(w @ (rounding * np.abs(p))) + scales.energy_floor
    total = float(w @ np.abs(work))
    if discrete.epsilon > 0.0:
        floor += float(w @ (rounding * np.maximum(depth, 0.0))) / discrete.epsilon
    found["contact law"] = _ratio(total, WORK * scales.energy + floor)
    return found


def _friction(parameters: Parameters, discrete: Discrete, state: State, scales: _Scales) -> Found:
    contact = discrete.contact
    assert contact is not None
    w = contact.weights
    u = contact.of(state.u)
    slip = u - np.einsum("kd,kd->k", u, contact.normals)[:, None] * contact.normals
    s = np.linalg.norm(slip, axis=1)
    size = np.linalg.norm(state.traction, axis=1)
    bound, smoothed = own_bound(parameters, discrete, state, s)
    bound = np.where(contact.slides, bound, np.minimum(bound, state.bound))
    peak = float(np.abs(bound).max(initial=0.0))
    # The scale of the friction bound is the stress in the body, also where the contact only grazes.
    stress = math.sqrt(
        2.0 * scales.energy * float(np.median(discrete.law[:, -1, -1])) / discrete.volumes.sum()
    )
    floor = 1e-7 * stress + DIGITS * _EPS * float(scales.internal.max(initial=0.0)) / max(
        float(w.min()), 1e-300
    )
    found = {"friction bound": _ratio(np.abs(bound - state.bound).max(), EXCESS * peak + floor)}
    found["smoothed stress"] = smoothed
    held = _held(discrete)
    over = (size - bound * (1.0 + EXCESS) - floor)[~held]
    found["traction beyond its bound"] = _ratio(float(over.max(initial=0.0)), EXCESS * peak + floor)
    across = np.abs(np.einsum("kd,kd->k", state.traction, contact.normals))
    found["traction along the normal"] = _ratio(float(across.max()), EXCESS * peak + floor)
    along = np.einsum("kd,kd->k", state.traction, slip)
    length = discrete.regularisation
    inside = np.sqrt(np.maximum(state.bound**2 - size**2, 0.0))
    work = state.bound * np.hypot(s, length) - length * inside + along
    total = float(w[~held] @ np.abs(work[~held]))
    reach = length + float(np.abs(state.u).max(initial=0.0))
    rounding = float(w @ (bound + size)) * 8.0 * _EPS * reach
    energy = max(scales.energy, float(w @ (state.bound * s)))
    found["friction law"] = _ratio(total, WORK * energy + rounding + scales.energy_floor)
    return found


def own_bound(
    parameters: Parameters, discrete: Discrete, state: State, slip: FloatArray
) -> tuple[FloatArray, float]:
    """``mu(x, |u_tau|) |R sigma_nu|`` and how far R, where it is the identity, is not."""
    contact = discrete.contact
    assert contact is not None
    x = discrete.geometry.x[contact.nodes]
    # No friction acts at nodes that are held.
    mu = np.maximum(at(parameters.friction.coefficient or 0.0, x, s=slip), 0.0) * contact.decides
    smoothing = parameters.friction.smoothing
    if smoothing is None or smoothing.kernel != "none":
        return mu * np.abs(state.smoothed), 0.0
    peak = float(np.abs(state.pressure).max(initial=0.0))
    wrong = _ratio(float(np.abs(state.pressure + state.smoothed).max()), 1e-12 * peak)
    return mu * np.abs(state.pressure), wrong


def _held(discrete: Discrete) -> BoolArray:
    """(k,) nodes of Gamma_C of which a component is prescribed."""
    contact = discrete.contact
    assert contact is not None
    touched = abs(contact.seen) @ (~discrete.free).astype(float)
    return np.asarray((touched > 0.0).reshape(contact.normals.shape).any(axis=1))
