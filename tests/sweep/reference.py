"""The discrete problem as a second-order cone programme, solved by Clarabel.

    min  1/2 u'Ku - f'u + sum_K |K| n q_K^2 + sum_i w_i (G_i t_i + r_i^2/(2 eps))
    with |eps_K(u)| <= M_K + q_K,  u_nu,i - gap_i <= r_i,  |(u_tau,i, delta)| <= t_i

with the friction bound G of a solution and the regularisation delta of friction, q = 0 for n = inf
and r = 0 for eps = 0.  Without energy and friction, the smallest excess tau over limit and gap
tells whether anything is admissible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from contact_locking.arrays import FloatArray

from .discrete import Discrete, IntArray

TIGHT = {"tol_gap_rel": 1e-9, "tol_gap_abs": 1e-12, "tol_feas": 1e-10, "max_iter": 200}


class NoReference(Exception):
    """Clarabel did not converge."""


@dataclass
class _Rows:
    """``b - A x in K``, cone by cone."""

    A: list[sp.csr_matrix]
    b: list[FloatArray]
    cones: list[Any]


def smallest_excess(discrete: Discrete) -> float:
    """The least tau with ``|eps| <= M (1 + tau)`` and ``u_nu <= gap + tau L max M``.

    Positive, where nothing within limit and gap follows the prescribed displacements.
    """
    return _scalar_programme(discrete, scales_prescribed=False)


def largest_factor(discrete: Discrete) -> float:
    """The largest s such that s times the prescribed displacements can be followed."""
    return -_scalar_programme(discrete, scales_prescribed=True)


def _scalar_programme(discrete: Discrete, scales_prescribed: bool) -> float:
    """min x_last over x = (u free/size, tau), or (u free/size, -s) with s u_D prescribed."""
    clarabel = _clarabel()
    free, count = np.flatnonzero(discrete.free), int(discrete.free.sum())
    limit = discrete.limit
    size = _size(discrete)
    rows = _Rows([], [], [])
    locks = np.flatnonzero(np.isfinite(limit))
    m = discrete.law.shape[1]
    if len(locks):
        lines = (locks[:, None] * m + np.arange(m)).ravel()
        B = discrete.strain[lines]
        scale = sp.diags(np.repeat(1.0 / limit[locks], m))
        below = sp.kron(sp.eye(len(locks)), sp.csr_matrix(np.eye(1 + m)[:, 1:]), "csr")
        above = sp.kron(np.ones((len(locks), 1)), sp.csr_matrix(np.eye(1 + m)[:, :1]), "csr")
        A = below @ scale @ B
        moved = A @ discrete.prescribed
        last = -moved[:, None] if scales_prescribed else above.toarray()
        rows.A.append(sp.hstack([A[:, free] * size, sp.csr_matrix(last)], "csr"))
        moved = above.toarray().ravel() + (0.0 if scales_prescribed else moved)
        rows.b.append(moved)
        rows.cones += [clarabel.SecondOrderConeT(1 + m)] * len(locks)
    if discrete.contact is not None:
        normal, gap = _normals(discrete)
        moved = normal @ discrete.prescribed
        last = moved if scales_prescribed else np.full(len(gap), size)
        part = sp.hstack([-normal[:, free] * size, sp.csr_matrix(last[:, None])], "csr")
        rows.A.append(part * (1.0 / size))
        rows.b.append((gap - (0.0 if scales_prescribed else moved)) / size)
        rows.cones.append(clarabel.NonnegativeConeT(len(gap)))
    # Bounds, so that there is always a least value.
    rows.A.append(sp.csr_matrix(([1.0], ([0], [count])), (1, count + 1)))
    rows.b.append(np.array([1e6 if scales_prescribed else 1.0]))
    rows.cones.append(clarabel.NonnegativeConeT(1))
    q = np.zeros(count + 1)
    q[-1] = 1.0
    x = _solve(clarabel, sp.csc_matrix((count + 1, count + 1)), q, rows)
    return float(x[-1])


def minimiser(discrete: Discrete, bound: FloatArray) -> FloatArray:
    """The displacement at a friction bound on the nodes of Gamma_C."""
    clarabel = _clarabel()
    free = np.flatnonzero(discrete.free)
    K = discrete.stiffness
    start, size = discrete.prescribed, _size(discrete)
    m, dim = discrete.law.shape[1], discrete.dim
    locks = np.flatnonzero(np.isfinite(discrete.limit))
    contact = discrete.contact
    slides = np.zeros(0, bool) if contact is None else (bound > 0.0) & contact.decides
    nodes = np.flatnonzero(slides)
    soft = len(locks) if math.isfinite(discrete.n) else 0
    normal, gap = (None, np.zeros(0)) if contact is None else _normals(discrete)
    yielding = len(gap) if discrete.epsilon > 0.0 else 0
    counts = [len(free), soft, yielding, len(nodes)]
    ends = np.cumsum([0, *counts])
    force = float(K.diagonal().max()) * size
    # Displacements in units of size, penetrations too, strains as they are over M.
    P = [K[free][:, free] * size, sp.csr_matrix((0, 0)), sp.csr_matrix((0, 0))]
    limits = discrete.limit[locks]
    if soft:
        P[1] = sp.diags(2.0 * discrete.n * discrete.volumes[locks] * limits**2) / size
    if yielding:
        assert contact is not None
        P[2] = sp.diags(contact.weights[contact.decides] / discrete.epsilon) * size
    P.append(sp.csr_matrix((len(nodes), len(nodes))))
    q = np.zeros(ends[-1])
    q[: len(free)] = (K @ start - discrete.load)[free]
    if contact is not None:
        q[ends[3] :] = (contact.weights * bound)[nodes]
    rows = _Rows([], [], [])

    def add(height: int, cones: list[Any], b: FloatArray, **blocks: sp.csr_matrix) -> None:
        parts = [
            blocks.get(name, sp.csr_matrix((height, count)))
            for name, count in zip("uqrt", counts, strict=True)
        ]
        rows.A.append(sp.hstack([part for part in parts if part.shape[1]], "csr"))
        rows.b.append(b)
        rows.cones.extend(cones)

    if normal is not None and len(gap):
        blocks = {"u": -normal[:, free]}
        if yielding:
            blocks["r"] = sp.eye(len(gap), format="csr")
        b = (gap - normal @ start) / size
        add(len(gap), [clarabel.NonnegativeConeT(len(gap))], b, **blocks)
    if len(locks):
        lines = (locks[:, None] * m + np.arange(m)).ravel()
        below = sp.kron(sp.eye(len(locks)), sp.csr_matrix(np.eye(1 + m)[:, 1:]), "csr")
        first = sp.kron(sp.eye(len(locks)), sp.csr_matrix(np.eye(1 + m)[:, :1]), "csr")
        B = below @ sp.diags(np.repeat(1.0 / limits, m)) @ discrete.strain[lines]
        blocks = {"u": B[:, free] * size}
        if soft:
            blocks["q"] = first
        b = first @ np.ones(len(locks)) + B @ start
        add((1 + m) * len(locks), [clarabel.SecondOrderConeT(1 + m)] * len(locks), b, **blocks)
    if len(nodes):
        assert contact is not None
        width = dim + (discrete.regularisation > 0.0)
        tangents = _tangents(discrete, nodes)
        below = sp.kron(sp.eye(len(nodes)), sp.csr_matrix(np.eye(width)[:, 1:dim]), "csr")
        first = sp.kron(sp.eye(len(nodes)), sp.csr_matrix(np.eye(width)[:, :1]), "csr")
        b = below @ (tangents @ start) / size
        if width > dim:
            b[width - 1 :: width] = discrete.regularisation / size
        cones = [clarabel.SecondOrderConeT(width)] * len(nodes)
        add(width * len(nodes), cones, b, u=below @ tangents[:, free], t=first)
    P = sp.block_diag([part for part in P if part.shape[0]], "csc") / force
    x = _solve(clarabel, P, q / force, rows)
    u = start.copy()
    u[free] = x[: len(free)] * size
    return u


def energy(discrete: Discrete, bound: FloatArray, u: FloatArray) -> float:
    """The objective at a displacement, with the least q, r and t that are feasible."""
    value = 0.5 * u @ (discrete.stiffness @ u) - discrete.load @ u
    if math.isfinite(discrete.n):
        over = np.linalg.norm(discrete.strains(u), axis=1) - discrete.limit
        value += discrete.n * discrete.volumes @ np.maximum(over, 0.0) ** 2
    contact = discrete.contact
    if contact is not None:
        at_nodes = contact.of(u)
        normal = np.einsum("kd,kd->k", at_nodes, contact.normals)
        slip = np.linalg.norm(at_nodes - normal[:, None] * contact.normals, axis=1)
        held = np.where(contact.decides, bound, 0.0) * contact.weights
        value += held @ np.hypot(slip, discrete.regularisation)
        if discrete.epsilon > 0.0:
            depth = np.where(contact.decides, np.maximum(normal - contact.gap, 0.0), 0.0)
            value += contact.weights @ depth**2 / (2.0 * discrete.epsilon)
    return float(value)


def _size(discrete: Discrete) -> float:
    """A length: displacements in this unit have strains about as large as the limit."""
    length = float(np.ptp(discrete.geometry.x, axis=0).max())
    finite = discrete.limit[np.isfinite(discrete.limit)]
    if len(finite):
        return float(np.max(finite)) * length
    moved = float(np.abs(discrete.prescribed).max(initial=0.0))
    load = float(np.abs(discrete.load).max(initial=0.0))
    pressed = load / float(discrete.stiffness.diagonal().max())
    return max(moved, pressed) or length


def _normals(discrete: Discrete) -> tuple[sp.csr_matrix, FloatArray]:
    """``u -> u_nu`` (k, dofs) and the gap (k,), where contact has a say."""
    contact, dim = discrete.contact, discrete.dim
    assert contact is not None
    nodes = np.flatnonzero(contact.decides)
    normals, columns = contact.normals[nodes], nodes[:, None] * dim + np.arange(dim)
    lines = np.repeat(np.arange(len(nodes)), dim)
    shape = (len(nodes), contact.seen.shape[0])
    matrix = sp.csr_matrix((normals.ravel(), (lines, columns.ravel())), shape) @ contact.seen
    return matrix.tocsr(), contact.gap[nodes]


def _tangents(discrete: Discrete, which: IntArray) -> sp.csr_matrix:
    """``u -> u_tau`` in an orthonormal basis at some nodes, (k (d - 1), dofs)."""
    contact, dim = discrete.contact, discrete.dim
    assert contact is not None
    bases = np.array([np.linalg.svd(contact.normals[i][None, :])[2][1:] for i in which])
    columns = np.asarray(which)[:, None, None] * dim + np.arange(dim)
    columns = np.broadcast_to(columns, bases.shape)
    lines = np.arange(len(which) * (dim - 1)).reshape(len(which), dim - 1, 1)
    lines = np.broadcast_to(lines, bases.shape)
    shape = (len(which) * (dim - 1), contact.seen.shape[0])
    found = sp.csr_matrix((bases.ravel(), (lines.ravel(), columns.ravel())), shape)
    return (found @ contact.seen).tocsr()


def _clarabel() -> Any:
    try:
        import clarabel
    except ImportError:
        raise NoReference("clarabel is not installed") from None
    return clarabel


def _solve(clarabel: Any, P: sp.csc_matrix, q: FloatArray, rows: _Rows) -> FloatArray:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    for name, value in TIGHT.items():
        setattr(settings, name, value)
    A, b = -sp.vstack(rows.A, "csc"), np.concatenate(rows.b)
    solver = clarabel.DefaultSolver(sp.triu(P, format="csc"), q, A, b, rows.cones, settings)
    found = solver.solve()
    if str(found.status) not in ("Solved", "AlmostSolved"):
        raise NoReference(f"Clarabel: {found.status}")
    return np.array(found.x)
