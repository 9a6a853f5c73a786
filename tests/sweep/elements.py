"""The body of a study in NumPy, SciPy and basix: strains, stresses and nodal forces.

Strains and stresses are vectors in Mandel's notation: xx, yy, sqrt2 xy in the plane; rr, zz, hoop,
sqrt2 rz around an axis; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy in space.
"""

from __future__ import annotations

import ast
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_NAMES = {
    name: getattr(np, name)
    for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "abs", "pi", "sign", "where")
} | {"min": np.minimum, "max": np.maximum, "inf": np.inf}


class _Choices(ast.NodeTransformer):
    """``a if c else b`` as ``where(c, a, b)``, which arrays have."""

    def visit_IfExp(self, node: ast.IfExp) -> ast.Call:
        self.generic_visit(node)
        return ast.Call(ast.Name("where", ast.Load()), [node.test, node.body, node.orelse], [])


def value(given: float | str, x: Array, **more: Any) -> Array:
    """An expression of a study file at points (k, d), read by Python itself."""
    names = dict(zip("xyz", x.T, strict=False)) | more
    found: Any = given
    if isinstance(given, str):
        tree = ast.fix_missing_locations(_Choices().visit(ast.parse(given, mode="eval")))
        found = eval(compile(tree, given, "eval"), {"__builtins__": {}}, _NAMES | names)
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


_CELLS = {
    (1, 2): ("interval", 1),
    (1, 3): ("interval", 2),
    (2, 3): ("triangle", 1),
    (2, 6): ("triangle", 2),
    (2, 4): ("quadrilateral", 1),
    (3, 4): ("tetrahedron", 1),
    (3, 10): ("tetrahedron", 2),
    (3, 8): ("hexahedron", 1),
}


class Reference:
    """A simplex of degree 1 or 2, or a box of degree 1, with ``dim`` axes, as basix has it."""

    def __init__(self, dim: int, nodes: int) -> None:
        name, degree = _CELLS[dim, nodes]
        self.dim, self.nodes = dim, nodes
        self.cell = basix.CellType[name]
        self.element = basix.create_element(basix.ElementFamily.P, self.cell, degree)
        self.is_box = name in ("quadrilateral", "hexahedron")
        self.is_quadratic = degree == 2
        #: The places of corners, and the corners of edges and sides.
        self.places = np.asarray(basix.geometry(self.cell))
        self.edges = [(int(a), int(b)) for a, b in basix.topology(self.cell)[1]]
        self.sides = basix.topology(self.cell)[dim - 1]
        self.corners = len(self.places)

    @property
    def middle(self) -> Array:
        return self.places.mean(axis=0, keepdims=True)

    def rule(self) -> tuple[Array, Array]:
        """Four points of Gauss and Jacobi along each axis, and weights."""
        return basix.make_quadrature(self.cell, 7, basix.QuadratureType.gauss_jacobi)

    def shapes(self, points: Array) -> tuple[Array, Array]:
        """Nodal functions (q, s) and their derivatives (q, s, a) along the axes."""
        values, *slopes = self.element.tabulate(1, points)[..., 0]
        return values, np.stack(slopes, axis=-1)


@dataclass(frozen=True)
class Points:
    """Points in cells: weights (c, p) and the map ``B`` (c, p, m, s, d) of strains."""

    local: Array
    weights: Array
    B: Array
    places: Array


class Body:
    """``strain``, ``forces``, the stiffness ``matrix`` and data of a study (plain data) on a mesh.

    Elasticity and the limit act at the points ``law``; the elastic stress of quadratic elements is
    integrated at the points ``elastic``.
    """

    def __init__(self, mesh: Mesh, study: dict[str, Any]) -> None:
        self.mesh, self.study, self.dim = mesh, study, mesh.dim
        self.cells, self.cell = mesh.cells, Reference(self.dim, mesh.cells.shape[1])
        self.quadratic = self.cell.is_quadratic
        self.at_vertices = not mesh.axisymmetric
        # The middle, or the corners drawn towards it, which is Gauss's rule inside of the cell.
        points, middle = self.cell.places, self.cell.middle
        if self.cell.is_box:
            points = middle + math.sqrt(1.0 / 3.0) * (points - middle)
        elif not self.quadratic:
            points = middle
        elif not self.at_vertices:
            points = middle + 0.5 * (points - middle)
        size = float(self.cell.rule()[1].sum())
        self.law = self._points(points, np.full(len(points), size / len(points)))

    def _points(self, local: Array, shares: Array) -> Points:
        dim = self.dim
        values, slopes = self.cell.shapes(local)
        places = np.einsum("qs,ksd->kqd", values, self.mesh.x[self.cells])
        # J_ad, the derivative of x_d along the axis a.
        jacobians = self.along(self.cells, self.cell, local)
        grads = np.einsum("qsa,kqda->kqsd", slopes, np.linalg.inv(jacobians))
        weights = np.abs(np.linalg.det(jacobians)) * shares
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
        return Points(local, weights, B, places)

    @cached_property
    def elastic(self) -> Points:
        """The points of the elastic stress: those of the law, or of an exact rule."""
        if self.quadratic and self.at_vertices:
            return self._points(*self.cell.rule())
        return self.law

    def operator(self, points: Points) -> sp.csr_matrix:
        """The map (c p m, k d) from displacements to strains at points."""
        c, p, m, s, d = points.B.shape
        dofs = (self.cells[:, :, None] * d + np.arange(d)).reshape(c, 1, s * d)
        columns = np.broadcast_to(dofs, (c, p * m, s * d))
        rows = np.repeat(np.arange(c * p * m), s * d)
        shape = (c * p * m, self.mesh.x.size)
        return sp.csr_matrix((points.B.ravel(), (rows, columns.ravel())), shape)

    def strain(self, u: Array, points: Points | None = None) -> Array:
        """(c, p, m) from u (k, d)."""
        points = points or self.law
        return np.asarray(self.operator(points) @ u.ravel()).reshape(points.B.shape[:3])

    def forces(self, stress: Array, points: Points | None = None) -> Array:
        """The nodal forces (k, d) of stresses (c, p, m)."""
        points = points or self.law
        weighted = (points.weights[..., None] * stress).ravel()
        return np.asarray(self.operator(points).T @ weighted).reshape(self.mesh.x.shape)

    @cached_property
    def stiffness(self) -> Array:
        """A (c, p, m, m) at the points of the law."""
        material = self.study["material"]
        A = self._tensor(material["elasticity"], self.law.places)
        for name, region in material.get("regions", {}).items():
            if region.get("elasticity"):
                where = self.mesh.regions[name]
                A[where] = self._tensor(region["elasticity"], self.law.places[where])
        return A

    def _tensor(self, given: dict[str, Any], places: Array) -> Array:
        m, shape = self.law.B.shape[2], places.shape[:2]
        x = places.reshape(-1, self.dim)
        if "stiffness" in given:
            rows = np.array([[value(entry, x) for entry in row] for row in given["stiffness"]])
            return np.moveaxis(rows, 2, 0).reshape(*shape, m, m).copy()
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

    @cached_property
    def elastic_stiffness(self) -> Array:
        """A at the points of the elastic stress."""
        if self.elastic is self.law:
            return self.stiffness
        linear, _ = Reference(self.dim, self.dim + 1).shapes(self.elastic.local)
        return np.einsum("qc,kcmn->kqmn", linear, self.stiffness)

    def thermal_stress(self, points: Points) -> Array:
        """``A eps_0`` (c, p, m); across a plane acts Lame's lambda of an isotropic law."""
        given = self.study["material"].get("eigenstrain", [])
        law = self.stiffness if points is self.law else self.elastic_stiffness
        found: Array = np.zeros(law.shape[:3])
        x, dim = points.places.reshape(-1, self.dim), self.dim
        for item in given if isinstance(given, list) else [given]:
            tensor = item.get("expansion", item.get("value"))
            entries = tensor if isinstance(tensor, list) else [tensor] * 3
            warm = value(item["temperature"], x) if "temperature" in item else 1.0
            normal = np.stack([value(entry, x) * warm for entry in entries], axis=1)
            normal = normal.reshape(*found.shape[:2], len(entries))
            stress = np.einsum("kpij,kpj->kpi", law[..., :dim], normal[..., :dim])
            if dim == 2 and len(entries) == 3:
                stress[..., :2] += law[..., 0, 1, None] * normal[..., 2:]
            names = item.get("on", [])
            where = [
                self.mesh.regions[name] for name in ([names] if names == str(names) else names)
            ]
            inside = np.concatenate(where) if where else np.arange(len(found))
            found[inside] += stress[inside]
        return found

    @cached_property
    def springs(self) -> sp.csr_matrix:
        """``int k (u . m)(v . m)``."""
        dim, size = self.dim, self.mesh.x.size
        found = sp.csr_matrix((size, size))
        for spring in self.study["loads"].get("springs", []):
            facets = self.facets(spring["on"])
            side = self.side(facets)
            points, shares = side.rule()
            normals = self.normals(facets, points)
            sizes = np.linalg.norm(normals, axis=2)
            along = spring.get("along")
            unit = normals / sizes[..., None]
            if isinstance(along, list):
                unit = np.broadcast_to(np.array(along) / np.linalg.norm(along), normals.shape)
            maps = np.einsum("fqi,fqj->fqij", unit, unit)
            if along is None:
                maps = np.broadcast_to(np.eye(dim), maps.shape)
            values = side.shapes(points)[0]
            stiffness = spring["stiffness"] * sizes * shares
            blocks = np.einsum("fq,qa,qb,fqij->faibj", stiffness, values, values, maps)
            dofs = (facets[:, :, None] * dim + np.arange(dim)).reshape(len(facets), -1)
            rows = np.repeat(dofs, dofs.shape[1], axis=1).ravel()
            columns = np.tile(dofs, (1, dofs.shape[1])).ravel()
            found = found + sp.csr_matrix((blocks.ravel(), (rows, columns)), (size, size))
        return found

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """The stiffness (k d, k d) of the body and its springs."""
        points, law = self.elastic, self.elastic_stiffness * self.elastic.weights[..., None, None]
        blocks = sp.block_diag(list(law.reshape(-1, *law.shape[2:])), "csr")
        strain = self.operator(points)
        return (strain.T @ blocks @ strain + self.springs).tocsr()

    def stress(self, strain: Array) -> Array:
        """A (eps - eps_0) at the points of the law."""
        elastic = np.einsum("kpmn,kpn->kpm", self.stiffness, strain)
        return np.asarray(elastic - self.thermal_stress(self.law))

    def elastic_forces(self, u: Array) -> tuple[Array, Array, float]:
        """Nodal forces of A eps(u), the sizes of their terms, and a(u, u)/2."""
        points, A = self.elastic, self.elastic_stiffness
        strain = self.strain(u, points)
        stress = np.einsum("kpmn,kpn->kpm", A, strain)
        energy = 0.5 * float(np.sum(points.weights * np.sum(stress * strain, axis=2)))
        B, A = abs(self.operator(points)), np.abs(A)
        sizes = (B @ np.abs(u).ravel()).reshape(strain.shape)
        sizes = points.weights[..., None] * np.einsum("kpmn,kpn->kpm", A, sizes)
        terms = np.asarray(B.T @ sizes.ravel()).reshape(u.shape)
        return self.forces(stress, points), terms, energy

    def facets(self, names: str | list[str]) -> Index:
        """The facets of one or several parts of the boundary."""
        parts = [self.mesh.parts[name] for name in ([names] if isinstance(names, str) else names)]
        return np.concatenate(parts)

    def side(self, facets: Index) -> Reference:
        return Reference(self.dim - 1, facets.shape[1])

    def along(self, nodes: Index, inner: Reference, points: Array) -> Array:
        """(k, q, a, d) the derivatives of x along the axes of cells or facets."""
        return np.einsum("qsa,ksd->kqad", inner.shapes(points)[1], self.mesh.x[nodes])

    def normals(self, facets: Index, points: Array | None = None) -> Array:
        """Outward normals (f, q, d) at points of facets, as long as the facets are large.

        Without points they are (f, d), in the middle.
        """
        side = self.side(facets)
        edges = self.along(facets, side, side.middle if points is None else points)
        edges = np.moveaxis(edges, 2, 0)
        if self.dim == 2:
            found = np.stack([edges[0][..., 1], -edges[0][..., 0]], axis=-1)
        else:
            found = np.cross(edges[0], edges[1])
        inner = [self._inner[key] for key in _keys(facets[:, : side.corners])]
        away = self.mesh.x[facets[:, 0]] - np.array(inner).reshape(-1, self.dim)
        found *= np.sign(np.einsum("fqd,fd->f", found, away))[:, None, None]
        return found[:, 0] if points is None else found

    @cached_property
    def _inner(self) -> dict[tuple[int, ...], Array]:
        """The middle of the cell behind a facet, by the corners of the facet."""
        corners = self.cells[:, : self.cell.corners]
        middles = self.mesh.x[corners].mean(axis=1)
        return {
            key: middle
            for side in self.cell.sides
            for key, middle in zip(_keys(corners[:, side]), middles, strict=True)
        }

    def loads(self, time: float) -> Array:
        """Nodal forces (k, d) of body force, tractions, pressures and heat."""
        loads = self.study["loads"]
        found = self.forces(self.thermal_stress(self.elastic), self.elastic)
        if loads.get("body_force"):
            jacobians = self.along(self.cells, self.cell, self.cell.rule()[0])
            sizes = np.abs(np.linalg.det(jacobians))
            found += self._integrated(self.cells, self.cell, sizes, loads["body_force"], time)
        for entry in loads.get("tractions", []):
            facets = self.facets(entry["on"])
            side = self.side(facets)
            sizes = np.linalg.norm(self.normals(facets, side.rule()[0]), axis=2)
            found += self._integrated(facets, side, sizes, entry["value"], time)
        for entry in loads.get("pressures", []):
            facets = self.facets(entry["on"])
            side = self.side(facets)
            ways = -self.normals(facets, side.rule()[0])
            for axis in range(self.dim):
                vector = [entry["value"] if axis == i else 0.0 for i in range(self.dim)]
                found += self._integrated(facets, side, ways[..., axis], vector, time)
        return found

    def _integrated(
        self, nodes: Index, inner: Reference, sizes: Array, vector: Any, time: float
    ) -> Array:
        points, shares = inner.rule()
        values, _ = inner.shapes(points)
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
    def _frames(self) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Directions (k, d, d) at each node, as columns, and which of them are free, (k, d)."""
        rows = np.zeros((len(self.mesh.x), self.dim, self.dim))
        for nodes, ways, _ in self.held(0.0):
            np.add.at(rows, nodes, np.einsum("ki,kj->kij", ways, ways))
        sizes, frames = np.linalg.eigh(rows)
        return frames, sizes < 1e-8

    @cached_property
    def free(self) -> Array:
        """(k, d, d) projections to the directions in which no condition holds a node."""
        frames, loose = self._frames
        return np.einsum("kia,ka,kja->kij", frames, loose.astype(float), frames)

    @cached_property
    def basis(self) -> sp.csc_matrix:
        """(k d, f) unit vectors along all free directions."""
        frames, loose = self._frames
        return sp.block_diag(list(frames), "csc")[:, loose.ravel()]

    def prescribed(self, time: float) -> Array:
        """(k, d) the least displacement that all conditions ask for."""
        rows = np.zeros((len(self.mesh.x), self.dim, self.dim))
        right = np.zeros_like(self.mesh.x)
        for nodes, ways, values in self.held(time):
            np.add.at(rows, nodes, np.einsum("ki,kj->kij", ways, ways))
            np.add.at(right, nodes, ways * values[:, None])
        return np.einsum("kij,kj->ki", np.linalg.pinv(rows, rcond=1e-8, hermitian=True), right)


def _keys(facets: Index) -> list[tuple[int, ...]]:
    """The corners of facets in ascending order."""
    return [tuple(int(node) for node in row) for row in np.sort(facets, axis=1)]
