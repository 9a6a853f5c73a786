"""The body of a study in NumPy alone: strains, stresses and nodal forces from nodes and cells.

Strains and stresses are vectors in Mandel's notation: xx, yy, sqrt2 xy in the plane; rr, zz, hoop,
sqrt2 rz around an axis; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy in space.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_NAMES = {
    name: getattr(np, name)
    for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "abs", "pi", "sign")
} | {"min": np.minimum, "max": np.maximum, "inf": np.inf}


def value(given: float | str, x: Array, **more: Any) -> Array:
    """An expression of a study file at points (k, d), read by Python itself."""
    names = dict(zip("xyz", x.T, strict=False)) | more
    found = eval(given, {"__builtins__": {}}, _NAMES | names) if isinstance(given, str) else given
    return np.broadcast_to(np.asarray(found, dtype=float), (len(x),)).copy()


@dataclass(frozen=True)
class Mesh:
    """Nodes ``x`` (k, d), ``cells`` and ``parts`` of the boundary by their nodes, corners first.

    ``regions`` has the cells of groups.
    """

    x: Array
    cells: Index
    parts: dict[str, Index]
    regions: dict[str, Index]
    axisymmetric: bool

    @property
    def dim(self) -> int:
        return int(self.x.shape[1])


def simplex_rule(dim: int, count: int = 4) -> tuple[Array, Array]:
    """Barycentric points (q, d + 1) and weights of sum 1, by Gauss's rule in collapsed axes."""
    roots, gauss = np.polynomial.legendre.leggauss(count)
    places: Array = 0.5 * (1.0 + roots)
    weights: Array = 0.5 * gauss
    rows: Array = np.ones((1, 1))
    sizes: Array = np.ones(1)
    for axis in range(dim):
        # Split the last coordinate into two shares.
        last = rows[:, -1:]
        split = np.kron(last, places[:, None])
        kept = np.repeat(rows, count, axis=0)
        rows = np.hstack([kept[:, :-1], split, kept[:, -1:] - split])
        density = (1.0 - places) ** (dim - 1 - axis)
        sizes = np.asarray(np.kron(sizes, weights * density), dtype=np.float64)
    return rows, sizes / sizes.sum()


def edges_of(count: int) -> list[tuple[int, int]]:
    """The pairs of corners of a simplex with ``count`` corners."""
    return list(combinations(range(count), 2))


def shapes(bary: Array, quadratic: bool) -> tuple[Array, Array]:
    """Nodal functions (q, s) and derivatives (q, s, c) by barycentric coordinates (q, c)."""
    q, c = bary.shape
    if not quadratic:
        return bary, np.broadcast_to(np.eye(c), (q, c, c))
    pairs = edges_of(c)
    values, slopes = np.zeros((q, c + len(pairs))), np.zeros((q, c + len(pairs), c))
    for i in range(c):
        values[:, i] = bary[:, i] * (2.0 * bary[:, i] - 1.0)
        slopes[:, i, i] = 4.0 * bary[:, i] - 1.0
    for n, (i, j) in enumerate(pairs, start=c):
        values[:, n] = 4.0 * bary[:, i] * bary[:, j]
        slopes[:, n, i], slopes[:, n, j] = 4.0 * bary[:, j], 4.0 * bary[:, i]
    return values, slopes


def ordered(x: Array, nodes: Index, corners: int) -> Index:
    """Nodes of simplices with their middles in the order of ``edges_of``, found by their place."""
    if nodes.shape[1] == corners:
        return nodes
    found = nodes.copy()
    middles = x[nodes[:, corners:]]
    for n, (i, j) in enumerate(edges_of(corners)):
        middle = 0.5 * (x[nodes[:, i]] + x[nodes[:, j]])
        which = np.linalg.norm(middles - middle[:, None], axis=2).argmin(axis=1)
        found[:, corners + n] = nodes[np.arange(len(nodes)), corners + which]
    return found


@dataclass(frozen=True)
class Points:
    """Points in cells: weights (c, p) and the map ``B`` (c, p, m, s, d) of strains."""

    bary: Array
    weights: Array
    B: Array
    places: Array


class Body:
    """``strain``, ``forces`` and data of a study (plain data) on a mesh."""

    def __init__(self, mesh: Mesh, study: dict[str, Any]) -> None:
        self.mesh, self.study, self.dim = mesh, study, mesh.dim
        self.quadratic = mesh.cells.shape[1] > mesh.dim + 1
        self.at_vertices = not mesh.axisymmetric
        self.cells = ordered(mesh.x, mesh.cells, self.dim + 1)
        c = self.dim + 1
        if not self.quadratic:
            self.law = self._points(np.full((1, c), 1.0 / c), np.ones(1))
        elif self.at_vertices:
            self.law = self._points(np.eye(c), np.full(c, 1.0 / c))
        else:
            # Gauss's rule of degree 2.
            near = {3: 2.0 / 3.0, 4: (5.0 + 3.0 * math.sqrt(5.0)) / 20.0}[c]
            far = (1.0 - near) / (c - 1)
            self.law = self._points(far + (near - far) * np.eye(c), np.full(c, 1.0 / c))

    def _points(self, bary: Array, shares: Array) -> Points:
        dim = self.dim
        values, slopes = shapes(bary, self.quadratic)
        places = np.einsum("qs,ksd->kqd", values, self.mesh.x[self.cells])
        # J_ad, the derivative of x_d by the barycentric coordinate a + 1.
        jacobians = self.along(self.cells, bary)
        grads = np.einsum(
            "qsa,kqda->kqsd", slopes[..., 1:] - slopes[..., :1], np.linalg.inv(jacobians)
        )
        weights = np.abs(np.linalg.det(jacobians)) / math.factorial(dim) * shares
        pairs = {2: [(0, 1)], 3: [(1, 2), (0, 2), (0, 1)]}[dim]
        hoop = int(self.mesh.axisymmetric)
        m = dim + hoop + len(pairs)
        B = np.zeros((*grads.shape[:2], m, grads.shape[2], dim))
        for i in range(dim):
            B[:, :, i, :, i] = grads[..., i]
        if hoop:
            radius = places[..., 0]
            B[:, :, 2, :, 0] = values[None] / radius[..., None]
            weights = weights * 2.0 * math.pi * radius
        for n, (i, j) in enumerate(pairs, start=dim + hoop):
            B[:, :, n, :, i] = math.sqrt(0.5) * grads[..., j]
            B[:, :, n, :, j] = math.sqrt(0.5) * grads[..., i]
        return Points(bary, weights, B, places)

    @cached_property
    def elastic(self) -> Points:
        """The points of the elastic stress: those of the law, or of an exact rule."""
        if self.quadratic and self.at_vertices:
            return self._points(*simplex_rule(self.dim))
        return self.law

    def strain(self, u: Array, points: Points | None = None) -> Array:
        """(c, p, m) from u (k, d)."""
        return np.einsum("kpmsd,ksd->kpm", (points or self.law).B, u[self.cells])

    def forces(self, stress: Array, points: Points | None = None) -> Array:
        """The nodal forces (k, d) of stresses (c, p, m)."""
        points = points or self.law
        parts = np.einsum("kpmsd,kpm,kp->ksd", points.B, stress, points.weights)
        found = np.zeros_like(self.mesh.x)
        np.add.at(found, self.cells, parts)
        return found

    @cached_property
    def stiffness(self) -> Array:
        """A (c, p, m, m) at the points of the law."""
        material = self.study["material"]
        A = self._tensor(material["elasticity"], self.law.places)
        for name, region in material.get("regions", {}).items():
            where = self.mesh.regions[name]
            A[where] = self._tensor(region["elasticity"], self.law.places[where])
        return A

    def _tensor(self, given: dict[str, Any], places: Array) -> Array:
        m, shape = self.law.B.shape[2], places.shape[:2]
        if "stiffness" in given:
            return np.broadcast_to(np.array(given["stiffness"]), (*shape, m, m)).copy()
        x = places.reshape(-1, self.dim)
        if "lambda" in given:
            lame, shear = value(given["lambda"], x), value(given["mu"], x)
        else:
            young, nu = value(given["young"], x), value(given["poisson"], x)
            shear = young / (2.0 * (1.0 + nu))
            lame = young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
        if self.study["material"].get("plane") == "stress":
            lame = 2.0 * lame * shear / (lame + 2.0 * shear)
        normal = self.dim + int(self.mesh.axisymmetric)
        trace = np.where(np.arange(m) < normal, 1.0, 0.0)
        law = lame[:, None, None] * np.outer(trace, trace) + 2.0 * shear[:, None, None] * np.eye(m)
        return law.reshape(*shape, m, m)

    def stress(self, strain: Array) -> Array:
        """A eps at the points of the law."""
        return np.einsum("kpmn,kpn->kpm", self.stiffness, strain)

    def elastic_forces(self, u: Array) -> tuple[Array, Array, float]:
        """Nodal forces of A eps(u), the sizes of their terms, and a(u, u)/2."""
        points, A = self.elastic, self.stiffness
        if points is not self.law:
            A = np.einsum("qc,kcmn->kqmn", points.bary, A)
        strain = self.strain(u, points)
        stress = np.einsum("kpmn,kpn->kpm", A, strain)
        energy = 0.5 * float(np.sum(points.weights * np.sum(stress * strain, axis=2)))
        B = np.abs(points.B)
        sizes = np.einsum("kpmsd,ksd->kpm", B, np.abs(u[self.cells]))
        sizes = np.einsum("kpmn,kpn->kpm", np.abs(A), sizes)
        parts = np.einsum("kpmsd,kpm,kp->ksd", B, sizes, points.weights)
        terms = np.zeros_like(self.mesh.x)
        np.add.at(terms, self.cells, parts)
        return self.forces(stress, points), terms, energy

    def facets(self, name: str) -> Index:
        return ordered(self.mesh.x, self.mesh.parts[name], self.dim)

    def along(self, nodes: Index, bary: Array) -> Array:
        """(k, q, a, d) the derivatives of x by the barycentric coordinates after the first."""
        _, slopes = shapes(bary, self.quadratic)
        return np.einsum("qsa,ksd->kqad", slopes[..., 1:] - slopes[..., :1], self.mesh.x[nodes])

    def normals(self, facets: Index, bary: Array | None = None) -> Array:
        """Outward normals (f, q, d) at points of facets, as long as the facets are large.

        Without points they are (f, d), in the middle.
        """
        x, dim = self.mesh.x, self.dim
        middle = np.full((1, dim), 1.0 / dim)
        edges = np.moveaxis(self.along(facets, middle if bary is None else bary), 2, 0)
        if dim == 2:
            found = np.stack([edges[0][..., 1], -edges[0][..., 0]], axis=-1)
        else:
            found = 0.5 * np.cross(edges[0], edges[1])
        away = x[facets[:, 0]] - np.array([self._inner[tuple(sorted(f[:dim]))] for f in facets])
        found *= np.sign(np.einsum("fqd,fd->f", found, away))[:, None, None]
        return found[:, 0] if bary is None else found

    @cached_property
    def _inner(self) -> dict[tuple[int, ...], Array]:
        """The place of the corner across, by the corners of a facet."""
        return {
            tuple(sorted(np.delete(cell, i))): self.mesh.x[cell[i]]
            for cell in self.cells[:, : self.dim + 1]
            for i in range(self.dim + 1)
        }

    def loads(self, time: float) -> Array:
        """Nodal forces (k, d) of body force, tractions and pressures."""
        found, loads = np.zeros_like(self.mesh.x), self.study["loads"]
        if "body_force" in loads:
            jacobians = self.along(self.cells, simplex_rule(self.dim)[0])
            sizes = np.abs(np.linalg.det(jacobians)) / math.factorial(self.dim)
            found += self._integrated(self.cells, sizes, loads["body_force"], time)
        for entry in loads.get("tractions", []):
            facets = self.facets(entry["on"])
            sizes = np.linalg.norm(self.normals(facets, simplex_rule(self.dim - 1)[0]), axis=2)
            found += self._integrated(facets, sizes, entry["value"], time)
        for entry in loads.get("pressures", []):
            facets = self.facets(entry["on"])
            ways = -self.normals(facets, simplex_rule(self.dim - 1)[0])
            for axis in range(self.dim):
                vector = [entry["value"] if axis == i else 0.0 for i in range(self.dim)]
                found += self._integrated(facets, ways[..., axis], vector, time)
        return found

    def _integrated(self, nodes: Index, sizes: Array, vector: Any, time: float) -> Array:
        corners = {self.cells.shape[1]: self.dim + 1}.get(nodes.shape[1], self.dim)
        bary, shares = simplex_rule(corners - 1)
        values, _ = shapes(bary, self.quadratic)
        places = np.einsum("qs,ksd->kqd", values, self.mesh.x[nodes])
        weights = sizes * shares
        if self.mesh.axisymmetric:
            weights = weights * 2.0 * math.pi * places[..., 0]
        found = np.zeros_like(self.mesh.x)
        for axis, component in enumerate(vector):
            density = value(component, places.reshape(-1, self.dim), t=time)
            parts = np.einsum("qs,kq->ks", values, weights * density.reshape(weights.shape))
            np.add.at(found[:, axis], nodes, parts)
        return found

    def held(self, time: float) -> list[tuple[Index, Array, Array]]:
        """Of each condition the nodes (k,), the directions (k, d) and the values (k,) of u . m."""
        x, dim = self.mesh.x, self.dim
        found: list[tuple[Index, Array, Array]] = []
        if self.mesh.axisymmetric:
            axis = np.flatnonzero(np.abs(x[:, 0]) <= 1e-12 * np.ptp(x[:, 0]))
            found.append((axis, np.tile(np.eye(dim)[0], (len(axis), 1)), np.zeros(len(axis))))
        for entry in self.study["loads"].get("displacements", []):
            nodes = np.unique(self.facets(entry["on"]))
            for i, given in enumerate(entry["value"]):
                if given is not None:
                    way = np.tile(np.eye(dim)[i], (len(nodes), 1))
                    found.append((nodes, way, value(given, x[nodes], t=time)))
        for entry in self.study["loads"].get("supports", []):
            facets = self.facets(entry["on"])
            nodes = np.unique(facets)
            if entry["along"] == "normal":
                # Of a flat part; the family has no other.
                way = self.normals(facets).sum(axis=0)
            else:
                way = np.array(entry["along"], dtype=float)
            way = np.tile(way / np.linalg.norm(way), (len(nodes), 1))
            found.append((nodes, way, value(entry.get("value", 0.0), x[nodes], t=time)))
        return found

    @cached_property
    def free(self) -> Array:
        """(k, d, d) projections to the directions in which no condition holds a node."""
        rows = np.zeros((len(self.mesh.x), self.dim, self.dim))
        for nodes, ways, _ in self.held(0.0):
            rows[nodes] += np.einsum("ki,kj->kij", ways, ways)
        sizes, frames = np.linalg.eigh(rows)
        loose = np.where(sizes < 1e-8, 1.0, 0.0)
        return np.einsum("kia,ka,kja->kij", frames, loose, frames)
