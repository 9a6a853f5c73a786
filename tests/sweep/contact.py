"""One contact of a study in NumPy alone: weights, control values, foundation, R and friction.

What two bodies limit is a jump between them, which is that of the program: the patch tests have
judged it, and nodes against segments (by_segments.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components, dijkstra

from .elements import Array, Body, Index, value

Bools = npt.NDArray[np.bool_]

# The cosines of the angles between two sides of a contact, and to the normals of the body.
_TURNED, _FACING = math.cos(math.radians(40.0)), math.cos(math.radians(60.0))
# Angles of the rule around a circle.
_ANGLES = 2000


@dataclass(frozen=True)
class Pairing:
    """The ``jump`` (m, k) between bodies at the m nodes of one side, with their weights.

    ``faces`` says which nodes face the other body, and ``gap`` is that without displacement.
    """

    jump: sp.csr_matrix
    faces: Bools
    weights: Array
    normals: Array
    gap: Array


class Contact:
    """The contact ``section`` of a study on a body."""

    def __init__(
        self,
        body: Body,
        section: dict[str, Any],
        common: dict[str, Any],
        pairing: Pairing | None = None,
    ) -> None:
        self.body, self.section, self.pairing = body, section, pairing
        self.friction = common | (section.get("friction") or {})
        mesh = body.mesh
        facets = body.facets(section["on"])
        self.nodes = np.unique(facets)
        self.facets = np.searchsorted(self.nodes, facets)
        self.x = mesh.x[self.nodes]
        self._given, self._side = facets, body.side(facets)
        self._points, shares = self._side.rule()
        sizes = np.linalg.norm(body.normals(facets, self._points), axis=2) * shares
        if mesh.axisymmetric:
            values = self._side.shapes(self._points)[0]
            radii = np.einsum("qs,ks->kq", values, self.x[self.facets, 0])
            sizes = sizes * 2.0 * math.pi * radii
        self._sizes = sizes
        self.weights: Array = np.zeros(len(self.nodes))
        np.add.at(self.weights, self.facets, sizes @ self._bernstein(self._points)[0])
        if pairing is not None:
            self.weights = pairing.weights

    def _bernstein(self, points: Array) -> tuple[Array, Array]:
        """Functions (q, s) of the values that contact limits, and derivatives (q, s, a)."""
        values, slopes = self._side.shapes(points)
        if not self.body.quadratic:
            return values, slopes
        # The nodal functions by Bernstein's: u_m = (c_1 + c_2)/4 + c_m/2 at the middles.
        change = np.eye(values.shape[1])
        for n, (i, j) in enumerate(self._side.edges, start=self._side.corners):
            change[n, [i, j, n]] = 0.25, 0.25, 0.5
        return values @ change, np.einsum("qsa,st->qta", slopes, change)

    @cached_property
    def controls(self) -> sp.csr_matrix:
        """Nodal values to the values that contact limits: 2 u_m - (u_1 + u_2)/2 at middles."""
        matrix, dim = sp.lil_matrix(sp.eye(len(self.nodes))), self.body.dim
        if self.body.quadratic:
            for n, (i, j) in enumerate(self._side.edges, start=dim):
                for facet in self.facets:
                    matrix[facet[n], [facet[i], facet[j], facet[n]]] = -0.5, -0.5, 2.0
        return matrix.tocsr()

    @cached_property
    def jump(self) -> sp.csr_matrix:
        """(m, k) the values that contact limits, from the displacements of all nodes."""
        if self.pairing is not None:
            return self.pairing.jump
        return self.controls @ sp.eye(len(self.body.mesh.x), format="csr")[self.nodes]

    def of(self, u: Array) -> Array:
        """(m, d) what contact limits of displacements (k, d)."""
        return np.asarray(self.jump @ u)

    def forces(self, tractions: Array) -> Array:
        """The nodal forces (k, d) of tractions (m, d)."""
        return np.asarray(self.jump.T @ (self.weights[:, None] * tractions))

    @cached_property
    def reach(self) -> sp.csr_matrix:
        """(m, k) which nodes are at a value: its own, or those of both bodies."""
        if self.pairing is not None:
            return self.pairing.jump
        return sp.eye(len(self.body.mesh.x), format="csr")[self.nodes]

    def decides(self, normals: Array) -> Bools:
        """(m,) whether contact has a say: where conditions leave the normal displacement free."""
        seen = sp.kron(self.reach, sp.eye(self.body.dim), "csr")
        along = sp.block_diag(list(normals[:, None, :]), "csr") @ seen @ self.body.basis
        return np.asarray(np.sqrt(along.power(2).sum(axis=1)) > 1e-6).ravel()

    @cached_property
    def loose(self) -> Bools:
        """(m,) where no condition holds a node."""
        held = np.abs(self.body.free - np.eye(self.body.dim)).max(axis=(1, 2)) > 1e-9
        return np.asarray(abs(self.reach) @ held.astype(float) == 0.0)

    @cached_property
    def slides(self) -> Bools:
        """(m,) where conditions leave two bodies a way to slide; without a body there is one."""
        found = np.ones(len(self.nodes), dtype=bool)
        if self.pairing is not None:
            free = np.einsum("kii->ki", self.body.free) > 0.5
            # The nodes of both sides that have the largest shares decide.
            for row, shares in enumerate(self.jump.toarray()):
                ends = [int(np.argmax(shares)), int(np.argmin(shares))]
                found[row] = shares.any() and free[ends].any(axis=0).sum() > 1
        return found

    @cached_property
    def outward(self) -> Array:
        """(k, d) the normals of the body, averaged over facets."""
        found = np.zeros_like(self.x)
        np.add.at(found, self.facets, self.body.normals(self._given, self._side.element.points))
        if self.body.mesh.axisymmetric:
            found[self.x[:, 0] <= 1e-12 * np.ptp(self.body.mesh.x[:, 0]), 0] = 0.0
        return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])

    @property
    def is_bent(self) -> bool:
        """Whether the middles of edges are off the curved boundary."""
        areas = self.body.normals(self._given)
        units = areas / np.linalg.norm(areas, axis=1)[:, None]
        return bool(self.body.quadratic and np.ptp(units, axis=0).max() > 1e-6)

    def _place(self, time: float) -> tuple[Array, Array]:
        """Rotation and translation x = R X + t of the tool; at the time 0 it is at rest."""
        dim = self.body.dim
        given = (self.section.get("foundation") or {}).get("motion")
        if given is None or time == 0.0:
            return np.eye(dim), np.zeros(dim)
        motion: dict[str, Any] = {"translation": given} if isinstance(given, list) else given
        origin = np.zeros((1, dim))
        shift = np.array([value(part, origin, t=time)[0] for part in motion["translation"]])
        if "rotation" not in motion:
            return np.eye(dim), shift
        about, turn = np.array(motion["about"]), motion["rotation"]
        angle = value(turn if dim == 2 else turn[1], origin, t=time)[0]
        c, s = math.cos(angle), math.sin(angle)
        R = np.array([[c, -s], [s, c]])
        if dim == 3:
            R = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        return R, about + shift - R @ about

    @property
    def is_free(self) -> bool:
        """Whether the place of the foundation is unknown."""
        return bool({"force", "spring"} & set(self.section.get("foundation", {})))

    def push(self, time: float) -> Array:
        """(d,) the force on the foundation."""
        given = (self.section.get("foundation") or {}).get("force", [0.0] * self.body.dim)
        origin = np.zeros((1, self.body.dim))
        return np.array([value(part, origin, t=time)[0] for part in given])

    def strongest(self, times: Sequence[float]) -> float:
        """The size of the largest of these forces."""
        return max((float(np.linalg.norm(self.push(time))) for time in times), default=0.0)

    def own_way(self, told: dict[str, Any]) -> Array:
        """(k, d) how far the foundation has moved beyond its motion."""
        way = np.zeros_like(self.x)
        if "tool" in told:
            way += told["tool"]["travel"] * np.array(told["tool"]["direction"])
        return way

    def drag(self, before: float, now: float) -> Array:
        """(k, d) how far the points of the tool that were at the nodes before have moved."""
        R, t = self._place(before)
        rest = (self.x - t) @ R
        R, t = self._place(now)
        return np.asarray(rest @ R.T + t - self.x)

    def normals_and_gap(self, time: float) -> tuple[Array, Array]:
        """Normals (k, d) towards the foundation, and gap (k,) at the nodes."""
        shape = self.section.get("foundation")
        if self.pairing is not None:
            added = value(self.section.get("gap", 0.0), self.x, t=time)
            return self.pairing.normals, self.pairing.gap + added
        if shape is None:
            return self.outward, value(self.section.get("gap", 0.0), self.x, t=time)
        R, t = self._place(time)
        distance, slope = _distance(shape, (self.x - t) @ R)
        return -slope @ R.T, distance

    @cached_property
    def rounding(self) -> float:
        """What rounding is in the gap."""
        size = float(np.abs(self.body.mesh.x).max())
        shape = self.section.get("foundation") or {}
        for key in {"half_space", "sphere", "cylinder"} & set(shape):
            numbers = [np.atleast_1d(part) for part in shape[key].values()]
            size += float(np.abs(np.concatenate(numbers)).sum())
        return 2e-15 * size

    def limited_gap(self, gap: Array) -> Array:
        """The values of a gap that contact limits, at most the largest of an edge, at least the
        least."""
        found = self.controls @ gap
        for n, (i, j) in enumerate(self._side.edges, start=self.body.dim):
            if self.body.quadratic:
                edge = gap[self.facets[:, [i, j, n]]]
                middle = self.facets[:, n]
                found[middle] = np.clip(found[middle], edge.min(axis=1), edge.max(axis=1))
        return np.asarray(found)

    def sides(self, normals: Array) -> Array:
        """(f,) whether the corners of a facet are on one side.

        Facets along which normals turn little and face the body join a side.
        """
        corners = self.facets[:, : self._side.corners]
        facing = np.einsum("kd,kd->k", normals, self.outward) > _FACING
        turns = np.einsum("fid,fjd->fij", normals[corners], normals[corners])
        joins = facing[corners].all(axis=1) & (turns > _TURNED).all(axis=(1, 2))
        starts = np.repeat(corners[joins][:, :1], corners.shape[1], axis=1).ravel()
        shape = (len(self.nodes),) * 2
        graph = sp.csr_matrix((np.ones(starts.size), (starts, corners[joins].ravel())), shape)
        part = connected_components(graph, directed=False)[1]
        return np.asarray(np.ptp(part[corners], axis=1) == 0)

    def smoothing(self, normals: Array, free: Bools) -> Array:
        """R (k, k); nodes that are not ``free`` have no part in it."""
        given = self.friction["smoothing"]
        kernel = given.get("kernel", "convolution")
        if kernel == "none":
            return np.eye(len(self.nodes))
        weights = np.where(free, self.weights, 0.0)
        joins = self.sides(normals)
        if kernel == "helmholtz":
            return self._filter(joins, weights, given["radius"])
        return self._convolution(joins, weights, given["radius"])

    def _convolution(self, joins: Array, weights: Array, radius: float) -> Array:
        graph = self._graph(joins)
        if self.body.dim == 2:
            apart = dijkstra(graph, directed=False)
        else:
            apart = np.linalg.norm(self.x[:, None] - self.x[None], axis=2)
            for node, row in enumerate(apart):
                ball = np.flatnonzero(row <= radius)
                _, piece = connected_components(graph[ball][:, ball], directed=False)
                joined = ball[piece == piece[np.searchsorted(ball, node)]]
                row[np.setdiff1d(np.arange(len(row)), joined)] = np.inf
        share = apart / radius
        if self.body.mesh.axisymmetric:
            radii = np.maximum(self.x[:, 0], 0.0)
            chord = 2.0 * np.sqrt(np.outer(radii, radii)) / radius
            angles = (np.arange(_ANGLES) + 0.5) * math.pi / _ANGLES
            kernel = np.mean([_kernel(np.hypot(share, chord * math.sin(0.5 * a))) for a in angles],
                             axis=0)  # fmt: skip
        else:
            kernel = _kernel(share)
        kernel = kernel * weights
        total = kernel.sum(axis=1, keepdims=True)
        return np.divide(kernel, total, out=np.zeros_like(kernel), where=total > 0.0)

    def _graph(self, joins: Array) -> sp.csr_matrix:
        """The lengths between neighbours on the pieces into which the nodes divide facets."""
        dim, count = self.body.dim, len(self.nodes)
        pieces = self.facets[joins]
        pairs = [pieces[:, [i, j]] for i, j in combinations(range(self._side.corners), 2)]
        if self.body.quadratic:
            middles = list(enumerate(self._side.edges, start=dim))
            pairs = [pieces[:, [i, n]] for n, (i, j) in middles]
            pairs += [pieces[:, [j, n]] for n, (i, j) in middles]
            pairs += [pieces[:, [n, m]] for n, _ in middles for m, _ in middles if n < m]
        ends: Index = np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)
        lengths = np.linalg.norm(self.x[ends[:, 0]] - self.x[ends[:, 1]], axis=1)
        upper = sp.csr_matrix((lengths, ends.T), (count, count))
        return (upper + upper.T).tocsr()

    def _filter(self, joins: Array, weights: Array, radius: float) -> Array:
        """``(m + r^2 K)^-1 m`` with the surface Laplacian K."""
        count = len(self.nodes)
        # Gradients in the facet, from its metric.
        edges = self.body.along(self._given, self._side, self._points)
        inverse = np.linalg.inv(np.einsum("fqid,fqjd->fqij", edges, edges))
        slopes = self._bernstein(self._points)[1]
        grads = np.einsum("qsi,fqij,fqjd->fqsd", slopes, inverse, edges)
        parts = np.einsum("fqsd,fqtd,fq->fst", grads, grads, self._sizes * joins[:, None])
        K = np.zeros((count, count))
        np.add.at(K, (self.facets[:, :, None], self.facets[:, None, :]), parts)
        # A part without free nodes has no pressure, whatever its mass.
        _, part = connected_components(sp.csr_matrix(np.abs(K) > 0.0), directed=False)
        dead = np.bincount(part, weights)[part] == 0.0
        mass = np.diag(np.where(dead, 1.0, weights))
        return np.asarray(np.linalg.solve(mass + radius**2 * K, mass))


def _kernel(share: Array) -> Array:
    inside = share < 1.0 - 1e-12
    return np.where(inside, np.exp(-1.0 / (1.0 - np.where(inside, share, 0.0) ** 2)), 0.0)


def _distance(shape: dict[str, Any], x: Array) -> tuple[Array, Array]:
    """Signed distance (k,), positive outside, and its gradient (k, d)."""
    if "half_space" in shape:
        normal = np.array(shape["half_space"]["normal"])
        normal = normal / np.linalg.norm(normal)
        return (x - np.array(shape["half_space"]["point"])) @ normal, np.tile(normal, (len(x), 1))
    if "expression" in shape:
        size = 1e-6 * float(np.ptp(x, axis=0).max())
        middle = value(shape["expression"], x)
        steps = size * np.eye(x.shape[1])
        ends = [[value(shape["expression"], x + s * step) for s in (1, -1)] for step in steps]
        slope = np.array([(a - b) / (2.0 * size) for a, b in ends]).T
        length = np.linalg.norm(slope, axis=1)
        return middle / length, slope / length[:, None]
    if "polyline" in shape:
        return _polyline(np.array(shape["polyline"]), x)
    given = shape.get("sphere") or shape["cylinder"]
    radial = x - np.array(given["centre"])
    if "cylinder" in shape and x.shape[1] == 3:
        axis = np.array(given.get("axis") or (0.0, 1.0, 0.0))
        axis = axis / np.linalg.norm(axis)
        radial = radial - np.outer(radial @ axis, axis)
    length = np.linalg.norm(radial, axis=1)
    return length - given["radius"], radial / length[:, None]


def _polyline(corners: Array, x: Array) -> tuple[Array, Array]:
    """The distance to the nearest segment, positive on the right of the way."""
    best, normal = np.full(len(x), np.inf), np.zeros_like(x)
    for start in range(len(corners) - 1):
        a: Array = corners[start]
        b: Array = corners[start + 1]
        way = (b - a) / np.linalg.norm(b - a)
        right = np.array([way[1], -way[0]])
        along = np.clip((x - a) @ way, 0.0, np.linalg.norm(b - a))
        away = x - (a + along[:, None] * way)
        size, sign = np.linalg.norm(away, axis=1), np.where(away @ right < 0.0, -1.0, 1.0)
        nearer = size < np.abs(best)
        direct = np.where((size < 1e-9 * np.abs(corners).max())[:, None], right,
                          sign[:, None] * away / np.maximum(size, 1e-300)[:, None])  # fmt: skip
        best[nearer], normal[nearer] = (sign * size)[nearer], direct[nearer]
    return best, normal
