"""The discrete problem as a second-order cone programme, solved by Clarabel.

    min  1/2 u'Ku - f'u + sum_K |K| n q_K^2 + sum_i w_i (G_i t_i + r_i^2/(2 eps))
    with |L eps_K(u)| <= M_K + q_K,  u_nu,i - gap_i <= r_i,  |(u_tau,i, delta)| <= t_i

for each set of strains |L eps| <= M, with the friction bound G of a solution and the regularisation
delta of friction, q = 0 for n = inf and r = 0 for eps = 0.  Without energy and friction, the
smallest excess tau over limit and gap tells whether anything is admissible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp

from contact_locking.results.solution import StudySolution
from contact_locking.study_file.dump import plain

from .elements import Array
from .judge import Judge, strain_sets
from .observed import mesh_of, moment_of

TIGHT = {"tol_gap_rel": 1e-9, "tol_gap_abs": 1e-12, "tol_feas": 1e-10, "max_iter": 200}


class NoReference(Exception):
    """Clarabel did not converge."""


@dataclass(frozen=True)
class StrainSet:
    """Rows (k r, k d) of displacements for ``|row| <= limit`` (k,), or row <= limit for r = 1."""

    rows: sp.csr_matrix
    limit: Array
    volumes: Array

    @property
    def height(self) -> int:
        return self.rows.shape[0] // len(self.limit)

    def excess(self, u: Array) -> Array:
        """How far a displacement is beyond the limit (k,)."""
        mapped = (self.rows @ u).reshape(len(self.limit), -1)
        size = mapped[:, 0] if self.height == 1 else np.linalg.norm(mapped, axis=1)
        return np.asarray(np.maximum(size - self.limit, 0.0))


@dataclass
class _Rows:
    """``b - A x in K``, cone by cone."""

    A: list[sp.csr_matrix] = field(default_factory=list)
    b: list[Array] = field(default_factory=list)
    cones: list[Any] = field(default_factory=list)


class Programme:
    """The programme of a judge's problem at a time; ``bounds`` (m,) are those of friction."""

    def __init__(self, judge: Judge, bounds: Sequence[Array] = (), time: float = 1.0) -> None:
        self.judge, body = judge, judge.body
        self.basis, self.stiffness = body.basis, body.matrix
        self.load = judge.loads(time).ravel()
        self.start = body.prescribed(time).ravel()
        strain = body.operator(body.law)
        m = body.law.B.shape[2]
        volumes = body.law.weights.ravel()
        self.sets: list[StrainSet] = []
        for maps, limits in strain_sets(body):
            locks = np.flatnonzero(np.isfinite(limits.ravel()))
            lines = (locks[:, None] * m + np.arange(m)).ravel()
            rows = sp.kron(sp.eye(len(locks)), sp.csr_matrix(maps)) @ strain[lines]
            self.sets.append(StrainSet(rows.tocsr(), limits.ravel()[locks], volumes[locks]))
        count, dim = len(self.start), body.dim
        normal, tangents = [sp.csr_matrix((0, count))], [sp.csr_matrix((0, count))]
        gaps: list[Array] = [np.zeros(0)]
        weights: list[Array] = [np.zeros(0)]
        held: list[Array] = [np.zeros(0)]
        none = [np.zeros(len(contact.nodes)) for contact in judge.contacts]
        for contact, bound in zip(judge.contacts, bounds or none, strict=True):
            normals, gap = contact.normals_and_gap(time)
            decides = np.flatnonzero(contact.decides(normals))
            seen = sp.kron(contact.jump, sp.eye(dim), "csr")
            normal.append((sp.block_diag(list(normals[:, None, :]), "csr") @ seen)[decides])
            gaps.append(contact.limited_gap(gap)[decides])
            weights.append(contact.weights[decides])
            rubs = decides[bound[decides] > 0.0]
            if len(rubs):
                frames = [np.linalg.svd(normals[i][None, :])[2][1:] for i in rubs]
                lines = (rubs[:, None] * dim + np.arange(dim)).ravel()
                tangents.append(sp.block_diag(frames, "csr") @ seen[lines])
                held.append((contact.weights * bound)[rubs])
        self.normal, self.gap = sp.vstack(normal, "csr"), np.concatenate(gaps)
        self.weights = np.concatenate(weights)
        self.tangents, self.held = sp.vstack(tangents, "csr"), np.concatenate(held)

    @property
    def size(self) -> float:
        """A length: displacements in this unit have strains about as large as the limit."""
        length = self.judge.extent
        limits = np.concatenate([np.abs(item.limit) for item in self.sets] or [np.zeros(0)])
        if len(limits):
            return float(np.max(limits)) * length
        moved = float(np.abs(self.start).max(initial=0.0))
        pressed = float(np.abs(self.load).max(initial=0.0)) / float(self.stiffness.diagonal().max())
        return max(moved, pressed) or length

    def smallest_excess(self) -> float:
        """The least tau with ``|L eps| <= M (1 + tau)`` and ``u_nu <= gap + tau L max M``.

        Positive, where nothing within limit and gap follows the prescribed displacements.
        """
        return self._scalar_programme(scales_prescribed=False)

    def largest_factor(self) -> float:
        """The largest s such that s times the prescribed displacements can be followed."""
        return -self._scalar_programme(scales_prescribed=True)

    def _scalar_programme(self, scales_prescribed: bool) -> float:
        """min x_last over x = (u free/size, tau), or (u free/size, -s) with s u_D prescribed."""
        clarabel = _clarabel()
        count, size = self.basis.shape[1], self.size
        rows = _Rows()
        for item in self.sets:
            scale = sp.diags(np.repeat(1.0 / item.limit, item.height))
            below, first = _cone(item, clarabel, rows)
            A, above = below @ scale @ item.rows, first @ np.ones(len(item.limit))
            moved = A @ self.start
            last = -moved[:, None] if scales_prescribed else above[:, None]
            rows.A.append(sp.hstack([A @ self.basis * size, sp.csr_matrix(last)], "csr"))
            rows.b.append(above + (0.0 if scales_prescribed else moved))
        if len(self.gap):
            moved = self.normal @ self.start
            last = moved if scales_prescribed else np.full(len(self.gap), size)
            part = sp.hstack(
                [-self.normal @ self.basis * size, sp.csr_matrix(last[:, None])], "csr"
            )
            rows.A.append(part * (1.0 / size))
            rows.b.append((self.gap - (0.0 if scales_prescribed else moved)) / size)
            rows.cones.append(clarabel.NonnegativeConeT(len(self.gap)))
        # Bounds, so that there is always a least value.
        rows.A.append(sp.csr_matrix(([1.0], ([0], [count])), (1, count + 1)))
        rows.b.append(np.array([1e6 if scales_prescribed else 1.0]))
        rows.cones.append(clarabel.NonnegativeConeT(1))
        q = np.zeros(count + 1)
        q[-1] = 1.0
        solver = _solver(clarabel, sp.csc_matrix((count + 1, count + 1)), q, rows, TIGHT)
        return float(_solved(solver)[-1])

    def minimiser(self, **options: Any) -> Array:
        """The displacement (k d,); raises NoReference."""
        return self.displacement(_solved(self.solver(**(TIGHT | options))))

    def displacement(self, unknowns: Sequence[float] | Array) -> Array:
        """The displacement that is part of the solver's unknowns."""
        free = np.array(unknowns[: self.basis.shape[1]])
        return np.asarray(self.start + self.basis @ free * self.size)

    def solver(self, **options: Any) -> Any:
        """Clarabel's solver with these settings, ready to solve for (u, q, r, t)."""
        clarabel = _clarabel()
        judge, size = self.judge, self.size
        Q, K = self.basis, self.stiffness
        dim = judge.body.dim
        points = sum(len(item.limit) for item in self.sets)
        soft = points if math.isfinite(judge.n) else 0
        yielding = len(self.gap) if judge.epsilon > 0.0 else 0
        counts = {"u": Q.shape[1], "q": soft, "r": yielding, "t": len(self.held)}
        force = float(K.diagonal().max()) * size
        # Displacements in units of size, penetrations too, strains as they are over M.
        P = [(Q.T @ K @ Q) * size]
        if soft:
            squares = [item.volumes * item.limit**2 for item in self.sets]
            P.append(sp.diags(2.0 * judge.n * np.concatenate(squares)) / size)
        if yielding:
            P.append(sp.diags(self.weights / judge.epsilon) * size)
        P.append(sp.csr_matrix((len(self.held),) * 2))
        linear = np.concatenate(
            [Q.T @ (K @ self.start - self.load), np.zeros(soft + yielding), self.held]
        )
        rows = _Rows()

        def add(b: Array, **blocks: sp.csr_matrix) -> None:
            parts = [blocks.get(name, sp.csr_matrix((len(b), n))) for name, n in counts.items()]
            rows.A.append(sp.hstack([part for part in parts if part.shape[1]], "csr"))
            rows.b.append(b)

        if len(self.gap):
            blocks = {"u": -self.normal @ Q}
            if yielding:
                blocks["r"] = sp.eye(len(self.gap), format="csr")
            rows.cones.append(clarabel.NonnegativeConeT(len(self.gap)))
            add((self.gap - self.normal @ self.start) / size, **blocks)
        done = 0
        for item in self.sets:
            below, first = _cone(item, clarabel, rows)
            B = below @ sp.diags(np.repeat(1.0 / item.limit, item.height)) @ item.rows
            blocks = {"u": B @ Q * size}
            if soft:
                own = sp.eye(len(item.limit), soft, k=done)
                blocks["q"] = first @ own
            add(first @ np.ones(len(item.limit)) + B @ self.start, **blocks)
            done += len(item.limit)
        if len(self.held):
            width = dim + (judge.delta > 0.0)
            nodes = len(self.held)
            below = sp.kron(sp.eye(nodes), sp.csr_matrix(np.eye(width)[:, 1:dim]), "csr")
            first = sp.kron(sp.eye(nodes), sp.csr_matrix(np.eye(width)[:, :1]), "csr")
            b = below @ (self.tangents @ self.start) / size
            if width > dim:
                b[width - 1 :: width] = judge.delta / size
            rows.cones += [clarabel.SecondOrderConeT(width)] * nodes
            add(b, u=below @ self.tangents @ Q, t=first)
        quadratic = sp.block_diag([part for part in P if part.shape[0]], "csc")
        return _solver(clarabel, quadratic / force, linear / force, rows, options)

    def energy(self, u: Array) -> float:
        """The objective at a displacement (k d,), with the least q, r and t that are feasible."""
        judge, dim = self.judge, self.judge.body.dim
        found = 0.5 * u @ (self.stiffness @ u) - self.load @ u
        if math.isfinite(judge.n):
            found += judge.n * sum(item.volumes @ item.excess(u) ** 2 for item in self.sets)
        slip = np.linalg.norm((self.tangents @ u).reshape(-1, dim - 1), axis=1)
        found += self.held @ np.hypot(slip, judge.delta)
        if judge.epsilon > 0.0:
            depth = np.maximum(self.normal @ u - self.gap, 0.0)
            found += self.weights @ depth**2 / (2.0 * judge.epsilon)
        return float(found)


def of_solution(solution: StudySolution) -> Programme:
    """The programme of a solved study at its friction bound."""
    study = plain(solution.parameters)
    mesh = mesh_of(solution.domain, solution.displacement.function_space, study)
    bounds = [touch.bound for touch in moment_of(solution, mesh).contacts]
    return Programme(Judge(study, mesh), bounds)


def _cone(item: StrainSet, clarabel: Any, rows: _Rows) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Add the cones of a set: where their entries below the first are, and where the first is."""
    count, height = len(item.limit), item.height
    if height == 1:
        rows.cones.append(clarabel.NonnegativeConeT(count))
        return -sp.eye(count, format="csr"), sp.eye(count, format="csr")
    rows.cones += [clarabel.SecondOrderConeT(1 + height)] * count
    below = sp.kron(sp.eye(count), sp.csr_matrix(np.eye(1 + height)[:, 1:]), "csr")
    first = sp.kron(sp.eye(count), sp.csr_matrix(np.eye(1 + height)[:, :1]), "csr")
    return below, first


def _clarabel() -> Any:
    try:
        import clarabel
    except ImportError:
        raise NoReference("clarabel is not installed") from None
    return clarabel


def _solver(clarabel: Any, P: sp.csc_matrix, q: Array, rows: _Rows, options: dict[str, Any]) -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    for name, wanted in options.items():
        setattr(settings, name, wanted)
    A, b = -sp.vstack(rows.A, "csc"), np.concatenate(rows.b)
    return clarabel.DefaultSolver(sp.triu(P, format="csc"), q, A, b, rows.cones, settings)


def _solved(solver: Any) -> Array:
    found = solver.solve()
    if str(found.status) not in ("Solved", "AlmostSolved"):
        raise NoReference(f"Clarabel: {found.status}")
    return np.array(found.x)
