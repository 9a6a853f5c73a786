"""Gamma_C in the discrete problem: nodes with weights and normals, and distances between nodes.

The points are the nodes, with the weights of the rule of the element's trace.  Contact and friction
act there on the limited values of the trace: the nodal values, or the control values.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.fem import compiled
from contact_locking.fem.contact_operator import ContactOperator
from contact_locking.fem.spaces import P1, ControlValues, Element, facet_nodes
from contact_locking.findings import Finding
from contact_locking.laws.body import WeightedMeasure
from contact_locking.mesh.distribution import marked, summed
from contact_locking.mesh.domain import Domain, is_on_axis
from contact_locking.parallel import maximum
from contact_locking.supports.conditions import Constraints

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

# Nodes at the distance of the radius count as outside, whatever the rounding.
_AT_RADIUS = 1e-12
# The number of nodes whose distances to all others are in memory at a time.
_ROWS = 256

#: The numbers of owned nodes and of other nodes, and their distances: (p,) each.
Pairs = tuple[IntArray, IntArray, FloatArray]


@dataclass(frozen=True)
class SurfaceMesh:
    """The nodes of Gamma_C with their weights, and its facets; made by ``ContactSurface.whole``.

    ``points`` (k, d), ``weights`` (k,) and ``facets`` (m, d), as numbers of nodes, are the same on
    every rank; ``owned`` is the range of the nodes that this rank owns.  ``axisymmetric`` says that
    the points (r, z) stand for circles.
    """

    points: FloatArray
    weights: FloatArray
    facets: IntArray
    owned: slice
    axisymmetric: bool = False

    @cached_property
    def edges(self) -> csr_matrix:
        """The lengths of the edges between nodes, as a symmetric matrix (k, k)."""
        from scipy.sparse import csr_matrix

        dim = self.points.shape[1]
        ends = [self.facets[:, [i, j]] for i in range(dim) for j in range(i)]
        pairs = np.unique(np.sort(np.concatenate(ends), axis=1), axis=0)
        lengths = np.linalg.norm(np.diff(self.points[pairs], axis=1)[:, 0], axis=1)
        shape = (len(self.points), len(self.points))
        upper = csr_matrix((lengths, (pairs[:, 0], pairs[:, 1])), shape=shape)
        return (upper + upper.T).tocsr()

    @cached_property
    def parts(self) -> IntArray:
        """(k,) the number of the connected part of Gamma_C on which each node lies."""
        from scipy.sparse.csgraph import connected_components

        return np.asarray(connected_components(self.edges, directed=False)[1], dtype=np.int64)

    def mean_by_part(self, values: FloatArray, weights: FloatArray) -> FloatArray:
        """(k,) the mean of ``values`` (k,) by ``weights`` (k,) over the part of each node."""
        sums, total = (np.bincount(self.parts, x) for x in (weights * values, weights))
        return np.asarray((sums / total)[self.parts])

    def within(self, radius: float) -> Iterator[Pairs]:
        """All p pairs of an owned node and a node nearer than ``radius``, some nodes at a time.

        Yields the numbers of owned nodes, in their order, the numbers of the other nodes, and the
        distances, (p,) each.  All pairs together may take more memory than a solve.

        In 2D the distance is the length of the curve between the nodes.  In 3D the distance is the
        length of the straight line, for nodes that are connected within the ball of that radius
        around the owned node: a fold that is near in space only does not count.  On a curved
        surface the straight line is shorter than the geodesic by the relative amount
        ``(radius * curvature)^2/24``.
        """
        near = self._along_curves if self.points.shape[1] == 2 else self._inside_balls
        for row, column, distance in near(radius):
            inside = distance < radius * (1.0 - _AT_RADIUS)
            yield row[inside], column[inside], distance[inside]

    def _along_curves(self, radius: float) -> Iterator[Pairs]:
        from scipy.sparse.csgraph import dijkstra

        first, last, _ = self.owned.indices(len(self.points))
        for start in range(first, last, _ROWS):
            some = np.arange(start, min(start + _ROWS, last))
            lengths = dijkstra(self.edges, directed=False, indices=some, limit=radius)
            row, column = np.nonzero(np.isfinite(lengths))
            yield row + start - first, column, lengths[row, column]

    def _inside_balls(self, radius: float) -> Iterator[Pairs]:
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        first, last, _ = self.owned.indices(len(self.points))
        tree = cKDTree(self.points)
        for node in range(first, last):
            ball = tree.query_ball_point(self.points[node], radius, return_sorted=True)
            column = np.asarray(ball, dtype=np.int64)
            _, piece = connected_components(self.edges[column][:, column], directed=False)
            column = column[piece == piece[np.searchsorted(column, node)]]
            lengths = np.linalg.norm(self.points[column] - self.points[node], axis=1)
            yield np.full(len(column), node - first), column, lengths


#: The normal displacement is prescribed where the free directions hold less of the unit normal.
PRESCRIBED = 1e-6
# The cosines of the angles by which contact normals turn between two sides of Gamma_C, and by which
# they are off the normals of the body: 40 and 60 degrees.
_TURNED, _FACING = 0.766, 0.5
# Distances are relative to displacements along a normal, at least to this share of the largest.
_LEAST = 1e-3
#: The sine of 15 degrees, by which the normal of a smooth boundary is off that of a chord at most.
CORNER = 0.26


@dataclass(frozen=True)
class Frame:
    """A pairing of the sides of two bodies, at the k owned nodes of side 1.

    - ``displacement``: at which they are paired, None for the mesh at rest
    - ``rows``: (k, N) the entries of the jump, for all N blocks of the displacement space
    - ``faces``: (k,) the nodes that have a condition
    - ``normals``, ``distance``: the contact normals (k, d), and distances (k,) of displaced sides
    - ``weights``, ``covered``: (k,) the covered areas of the nodes, and as shares of their areas
    """

    displacement: FloatArray | None
    rows: csr_matrix
    faces: BoolArray
    normals: FloatArray
    distance: FloatArray
    weights: FloatArray
    covered: FloatArray


class ContactSurface:
    """The nodes of Gamma_C in the element's spaces, with the weights of its rule.

    - ``nodes``, ``blocks``: (k,) the owned nodes in the scalar and in the vector space
    - ``points``, ``weights``: coordinates (k, d), and shares (k,) of the measure of Gamma_C
    - ``space``, ``degree``: of the displacements
    - ``controls``: the control values of quadratic fields
    - ``is_paired``, ``facing_length``: whether limited values are jumps to another body, and the
      length of a facet of its side

    The constructor is collective and raises InputError with ``key`` for an element without contact.
    """

    is_paired, facing_length = False, math.inf

    def __init__(
        self,
        domain: Domain,
        space: fem.FunctionSpace,
        names: tuple[str, ...],
        key: str = "on",
        element: Element = P1,
    ) -> None:
        element.trace.check(domain.dim, element.degree, key)
        self._pieces = np.array(element.trace.pieces[domain.dim], dtype=np.int32)
        self.domain, self.names, self._corners = domain, names, domain.kind.facet.corners
        self.facets = domain.facets(names, key)
        self.vector_space, self.degree = space, element.degree
        self.scalar_space, to_vector = _compat.collapse(space.sub(0))
        owned = self.scalar_space.dofmap.index_map.size_local
        test = ufl.TestFunction(self.scalar_space)
        lengths = domain.plain_ds(names, key, **element.trace.rules[domain.dim])
        # The weights also find an owned node of Gamma_C all of whose facets are on other ranks.
        mass = compiled.assembled(test * lengths)
        self.nodes = np.flatnonzero(mass[:owned] > 0.0).astype(np.int32)
        self.blocks = to_vector[self.nodes] // domain.dim
        self.weights = mass[self.nodes]
        self.points = self.scalar_space.tabulate_dof_coordinates()[self.nodes, : domain.dim]
        if domain.axisymmetric:
            self.points[is_on_axis(domain, self.points.T), 0] = 0.0
        self.controls = ControlValues(
            element.trace, self.scalar_space, space, self.nodes, to_vector // domain.dim
        )
        #: Where the sides of two bodies face each other, None for a foundation.
        self.frame: Frame | None = None
        #: The gap (k,) that the places of two sides leave.
        self.distance: FloatArray = np.zeros(len(self.nodes))
        self.ds = lengths
        is_plain = domain.kind.facet.is_simplex and not domain.axisymmetric
        # Every rule is exact for the gradients of affine fields.
        is_exact = is_plain and element.degree == 1
        self._exact_ds = lengths if is_exact else domain.ds(names, key)
        if not is_plain:
            self.ds = self._with_density(lengths, compiled.assembled(test * self._exact_ds))

    @cached_property
    def operator(self) -> ContactOperator:
        """The displacements that contact and friction limit; the first use is collective."""
        return ContactOperator(self.vector_space, self.controls.rows)

    def close(self) -> None:
        """Destroy the PETSc objects; collective."""
        if "operator" in self.__dict__:
            self.operator.destroy()

    def of_motion(self, motion: FloatArray) -> FloatArray:
        """The limited values (k, d) of an affine displacement (local values); collective."""
        # The control values of an affine field are its nodal values.
        return np.asarray(motion.reshape(-1, self.domain.dim)[self.blocks])

    def is_of(self, dofs: BoolArray) -> BoolArray:
        """(k,) whether each node is marked; ``dofs`` marks the local dofs of the vector space."""
        return np.asarray(dofs[self.blocks * self.domain.dim])

    @cached_property
    def body_normals(self) -> FloatArray:
        """The outward unit normals (k, d) averaged over facets; the first use is collective."""
        test = ufl.TestFunction(self.vector_space)
        integrals = ufl.inner(ufl.FacetNormal(self.domain.mesh), test) * self.ds
        normals = compiled.assembled(integrals).reshape(-1, self.domain.dim)[self.blocks]
        if self.domain.axisymmetric:
            # The facets around a point of the axis are those of a whole circle.
            normals[self.points[:, 0] == 0.0, 0] = 0.0
        return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])

    @cached_property
    def places(self) -> FloatArray:
        """Where the nodes (k, d) are on the curved boundary that the facets are chords of.

        The middle of an edge from corner 1 to 2 is off the chord by the sagitta
        ``|x_2 - x_1| (nu_2 - nu_1) . t/8`` along the normal, with the averaged normals nu of the
        body at the corners and the tangent t (docs/problem.md).  The first use is collective.
        """
        places = self.points.copy()
        if self.controls.are_nodal:
            return places
        function = self.vector_function(self.body_normals)
        scalars = self.scalar_function(self.weights)
        edges, nodes = (self.controls.edges(each) for each in (function, scalars))
        ends, middles, corners = edges[:, :2], edges[:, 2], nodes[:, :2]
        normals = function.x.array.reshape(-1, self.domain.dim)
        x = self.scalar_space.tabulate_dof_coordinates()[corners, : self.domain.dim]
        along = x[:, 1] - x[:, 0]
        length = np.linalg.norm(along, axis=1)
        slopes = np.einsum("mni,mi->mn", normals[ends], along / length[:, None])
        slopes[np.abs(slopes) > CORNER] = 0.0
        slopes = np.where(self._is_end(nodes), -slopes[:, ::-1], slopes)
        sagitta = length * (slopes[:, 1] - slopes[:, 0]) / 8.0
        places[np.searchsorted(self.nodes, nodes[:, 2])] += sagitta[:, None] * normals[middles]
        return places

    def _is_end(self, edges: IndexArray) -> BoolArray:
        """(m, 2) whether edges (m, 3), as nodes of the scalar space, end at the rim; collective."""
        index_map, nodes = self.scalar_space.dofmap.index_map, self.facet_nodes
        facets = summed(index_map, nodes, np.ones((*nodes.shape, 1)))[:, 0]
        # At a corner of Gamma_C, with one facet, the rim ends as well.
        is_end = facets[edges[:, :2]] == 1.0
        if self.domain.dim == 3:
            is_inside = facets[edges[:, 2]] > 1.0
            rim = marked(index_map, edges[~is_inside, :2])
            is_end |= is_inside[:, None] & rim[edges[:, :2]]
        return np.asarray(is_end)

    def free_nodes(self, normal: FloatArray, constraints: Constraints) -> BoolArray:
        """(k,) the nodes whose normal displacement is not prescribed.

        The other nodes are the held nodes: a displacement condition decides there, and neither
        pressure nor friction acts.  ``normal`` (k, d) is the contact normal; collective.
        """
        normals = self.vector_function(normal).x.array
        free = constraints.free_part(normals).reshape(-1, self.domain.dim)[self.blocks]
        return np.asarray(np.linalg.norm(free, axis=1) > PRESCRIBED)

    def sliding_nodes(self, constraints: Constraints) -> BoolArray:
        """(k,) the nodes whose jump conditions leave free along the other body; collective."""
        return np.ones(len(self.nodes), dtype=bool)

    def findings(self) -> list[Finding]:
        """Findings about the sides of two bodies."""
        return []

    def frame_at(self, displacement: FloatArray | None, must_face: bool = True) -> Frame | None:
        """The frame of two sides at a displacement (local values), None without; collective.

        Raises Misplaced for sides that ``must_face`` each other and do not.
        """
        return None

    def apart(
        self, displacement: FloatArray, presses: BoolArray, gap: FloatArray, entered: float
    ) -> float:
        """How far two sides are from touching at a displacement (local values); collective.

        0 on a foundation; see :meth:`PairedSurface.apart`.
        """
        return 0.0

    def extents(self, displacement: FloatArray, normals: FloatArray) -> FloatArray:
        """``max u . n - min u . n`` (k,) of a displacement u (local values); collective.

        The normals n (k, d) are those of this rank.  How far bodies slide counts little: the least
        value is 1e-3 of the largest displacement.
        """
        comm, moved = self.domain.comm, displacement.reshape(-1, self.domain.dim)
        parts = comm.allgather(normals)
        every, number = np.unique(np.concatenate(parts), axis=0, return_inverse=True)
        ends = [[np.max(moved @ n, initial=-np.inf) for n in sign * every] for sign in (1.0, -1.0)]
        sizes = np.sum(np.max(comm.allgather(ends), axis=0), axis=0)
        first = sum(map(len, parts[: comm.rank]))
        mine = number.reshape(-1)[first : first + len(normals)]
        return np.asarray(np.maximum(sizes[mine], _LEAST * maximum(comm, np.abs(moved))))

    def set_frame(self, frame: Frame) -> None:
        """Set the pairing; collective."""

    def whole(self, free: BoolArray | None = None, sides: IntArray | None = None) -> SurfaceMesh:
        """All of Gamma_C, on every rank; nodes that are not ``free`` have weight 0; collective.

        Facets whose corners lie on several ``sides`` (n,) of Gamma_C are left out.
        """
        comm = self.domain.comm
        weights = self.weights if free is None else np.where(free, self.weights, 0.0)
        first = sum(comm.allgather(len(self.nodes))[: comm.rank])
        facets = np.concatenate(comm.allgather(self._numbers(self.facet_nodes)))
        if sides is not None:
            facets = facets[np.ptp(sides[facets[:, : self._corners]], axis=1) == 0]
        pieces = np.sort(facets[:, self._pieces].reshape(-1, self.domain.dim), axis=1)
        return SurfaceMesh(
            np.concatenate(comm.allgather(self.points)),
            np.concatenate(comm.allgather(weights)),
            np.unique(pieces, axis=0),
            slice(first, first + len(self.nodes)),
            self.domain.axisymmetric,
        )

    def sides(self, normals: FloatArray) -> IntArray:
        """(n,) the number of the side on which each of all n nodes lies; collective.

        ``normals`` (k, d) are the contact normals.  A side is a part of Gamma_C that is joined by
        facets where the contact normal turns by less than 40 degrees between the corners, and is
        less than 60 degrees off the outward normal of the body.
        """
        comm = self.domain.comm
        facing = np.sum(normals * self.body_normals, axis=1) > _FACING
        every, faces, points = (
            np.concatenate(comm.allgather(x)) for x in (normals, facing, self.points)
        )
        corners = self._numbers(self.facet_nodes[:, : self._corners])
        corners = np.unique(np.concatenate(comm.allgather(corners)), axis=0)
        joins = faces[corners].all(axis=1)
        for first, other in combinations(corners.T, 2):
            joins &= np.sum(every[first] * every[other], axis=1) > _TURNED
        if joins.all():
            return np.zeros(len(every), dtype=np.int64)
        joined = self.domain.kind.facet.split(corners[joins])
        return SurfaceMesh(points, np.ones(len(points)), joined, slice(0, 0)).parts

    def scalar_function(self, values: FloatArray, name: str = "f") -> fem.Function:
        """A function with the given values (k,) on Gamma_C and zero elsewhere; collective."""
        function = fem.Function(self.scalar_space, name=name)
        function.x.array[self.nodes] = values
        function.x.scatter_forward()
        return function

    def limited_gap(self, gap: FloatArray) -> FloatArray:
        """The limited values (k,) of a gap (k,) at the nodes; collective.

        They are between the least and the largest gap at the nodes of an edge.  The control value
        of a gap that has a kink, as beside the edge of a tool, would be far off.
        """
        if self.controls.are_nodal:
            return gap
        function = self.scalar_function(gap)
        limited = self.controls.of_scalars(function)
        edges = self.controls.edges(function)
        values, rows = function.x.array[edges], np.searchsorted(self.nodes, edges[:, 2])
        limited[rows] = np.clip(limited[rows], values.min(axis=1), values.max(axis=1))
        return limited

    def vector_function(self, values: FloatArray, name: str = "f") -> fem.Function:
        """A vector function with the given values (k, d) on Gamma_C; collective."""
        function = fem.Function(self.vector_space, name=name)
        function.x.array.reshape(-1, self.domain.dim)[self.blocks] = values
        function.x.scatter_forward()
        return function

    def nodal_forces(self, tractions: FloatArray) -> FloatArray:
        """``int t . v`` of tractions t (k, d) at the points, at all local dofs; collective."""
        function = fem.Function(self.vector_space)
        forces = self.operator.forces(self.weights[:, None] * tractions)
        function.x.array[: len(forces)] = forces
        function.x.scatter_forward()
        return np.asarray(function.x.array)

    def facet_corners(self) -> FloatArray | None:
        """The corners (m, d, d) of the pieces of facets, on rank 0, otherwise None; collective.

        The nodes divide each facet of Gamma_C into pieces, one for affine displacements.
        """
        places = self.scalar_space.tabulate_dof_coordinates()[:, : self.domain.dim]
        pieces = self.facet_nodes[:, self._pieces].reshape(-1, self.domain.dim)
        gathered = self.domain.comm.gather(places[pieces])
        return None if gathered is None else np.concatenate(gathered)

    def integral(self, values: FloatArray) -> FloatArray:
        """``int w`` over Gamma_C for nodal values w (k,) or (k, d); collective."""
        return self.domain.comm.allreduce(np.tensordot(self.weights, values, axes=(0, 0)))

    def laplacian(self, sides: IntArray | None = None) -> PETSc.Mat:
        """``int grad_Gamma w . grad_Gamma v`` on the owned nodes of Gamma_C; collective.

        The unknowns are the limited values of w.  Facets whose corners lie on several ``sides``
        (n,) of Gamma_C are left out.
        """
        from dolfinx.fem import petsc

        w, v = ufl.TrialFunction(self.scalar_space), ufl.TestFunction(self.scalar_space)
        nu, comm = ufl.FacetNormal(self.domain.mesh), self.domain.comm
        density = ufl.inner(*(ufl.grad(f) - ufl.dot(ufl.grad(f), nu) * nu for f in (w, v)))
        if sides is not None and sides.any():
            # The function of degree 1 on facets with the sides as values at corners.
            first = sum(comm.allgather(len(self.nodes))[: comm.rank])
            function = self.scalar_function(sides[first : first + len(self.nodes)].astype(float))
            values, edges = function.x.array, self.controls.edges(function)
            values[edges[:, 2]] = values[edges[:, :2]].mean(axis=1)
            function.x.scatter_forward()
            side = ufl.grad(function)
            along = side - ufl.dot(side, nu) * nu
            size = ufl.CellDiameter(self.domain.mesh)
            density *= ufl.conditional(ufl.lt(size**2 * ufl.inner(along, along), 0.5), 1.0, 0.0)
        full = petsc.assemble_matrix(compiled.form(density * self._exact_ds))
        full.assemble()
        index_map = self.scalar_space.dofmap.index_map
        rows = PETSc.IS().createGeneral(
            (self.nodes + index_map.local_range[0]).astype(PETSc.IntType), comm=comm
        )
        nodal = full.createSubMatrix(rows, rows)
        rows.destroy()
        full.destroy()
        if self.controls.are_nodal:
            return nodal
        every = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        inverse = self.controls.inverse(self.nodes, self._numbers(every).astype(np.int32))
        starts, columns = (
            array.astype(PETSc.IntType) for array in (inverse.indptr, inverse.indices)
        )
        to_nodal = PETSc.Mat().createAIJ(
            nodal.getSizes(), csr=(starts, columns, inverse.data), comm=comm
        )
        surface = nodal.ptap(to_nodal)
        to_nodal.destroy()
        nodal.destroy()
        return surface

    def _with_density(self, lengths: ufl.Measure, integrals: FloatArray) -> ufl.Measure:
        """The measure of Gamma_C with exact weights; sets ``weights``; collective.

        The rule of the trace would give the nodes on the axis of an axisymmetric body, where r is
        0, no weight, and is not exact for the functions of nodes on a quadrilateral that is no
        parallelogram.  The weight of a node is therefore the integral of the function of its
        limited value, a hat function or one of Bernstein's; ``integrals`` are those of the nodal
        functions.  The density of the measure, which counts at nodes, is the quotient of weights.
        """
        values = fem.Function(self.scalar_space)
        to_nodal = self.controls.inverse(self.nodes, np.arange(len(values.x.array)))
        values.x.array[:] = to_nodal.T @ integrals[self.nodes]
        values.x.scatter_reverse(la.InsertMode.add)
        weights = values.x.array[self.nodes]
        density = self.scalar_function(weights / self.weights)
        self.weights = weights
        return WeightedMeasure(lengths, density)

    def _numbers(self, nodes: IndexArray) -> IntArray:
        """Local nodes (m, n) of the scalar space as numbers of nodes on all ranks; collective.

        The numbers of nodes off Gamma_C have no meaning.
        """
        index_map = self.scalar_space.dofmap.index_map
        # The ranks own dofs in ascending order, so that the gathered ones ascend as well.
        every = self.domain.comm.allgather(index_map.local_to_global(self.nodes))
        local = index_map.local_to_global(nodes.reshape(-1)).reshape(nodes.shape)
        return np.searchsorted(np.concatenate(every), local)

    @cached_property
    def facet_nodes(self) -> IndexArray:
        """The local nodes (m, n) of the facets of Gamma_C in the scalar space, corners first."""
        cells = self.domain.owners(self.facets)
        return facet_nodes(self.domain, self.scalar_space, self.facets, cells)
