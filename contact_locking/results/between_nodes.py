"""Where a foundation enters the body: between the nodes of Gamma_C, and outside of Gamma_C.

On a facet with the moved points y(s) the depth is ``d(s) = -phi(y(s))``, with the distance phi of
the foundation, or ``u_nu - gap`` of a given gap.  The entry between the nodes is the largest
``d(s) - sum_i N_i(s) [d_i]^+``: the depth beyond that of the nodes of the facet, where penalties,
held nodes and the linearisation of the gap leave some, and beyond what the chord of a hollow
boundary explains.  The search evaluates a lattice of points on each facet and continues from the
best of them with steps that halve, which finds the deepest point of a convex foundation.  Corners
and sharp edges of a foundation made of facets are searched behind the facets of the body.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.contact.surface import CORNER, ContactSurface
from contact_locking.mesh.data import facet_normals, nodal_functions, unit_normals
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import maximum, peak
from contact_locking.problem.rounding import ROUNDING

# The parts of each edge of a facet in the lattice, by the dimension of the body, and the halvings
# of the steps of the search from the best point.
_DIVISIONS, _HALVINGS = {2: 16, 3: 6}, 5
# The normals of a foundation at the nodes of a facet show its curvature if they turn by less.
_KNOWN = 0.7
# Nodes within this multiple of the radius of a facet are around it, and a foundation that enters by
# this share of its indentation at one of them is seen there.
_AROUND, _SEEN = 3.0, 0.5
# An indentation is at least this share of the largest displacement: a smaller one is of the order
# of the square of the displacements, which the linearised contact conditions leave out.
_LEAST = 1e-4
#: Where a foundation enters between the nodes by this share of its indentation, nodes are missing.
NOTABLE = 0.1
# A corner of the foundation is looked for as deep as this multiple of the radius of a facet.
_REACH = 1.5
# Sharp edges are looked for at points that are this share of the least radius of a facet apart.
_SPACING = 0.25
# The nodes of facets, or of the triangles that divide quadrilaterals, by kind and degree: the first
# d are the corners of a triangle, and all are numbered as those of the whole from its first corner.
_HALVES = {
    ("interval", 1): ((0, 1),),
    ("interval", 2): ((0, 1, 2),),
    ("triangle", 1): ((0, 1, 2),),
    ("triangle", 2): ((0, 1, 2, 3, 4, 5),),
    ("quadrilateral", 1): ((0, 1, 2, 3), (3, 2, 1, 0)),
}
# A corner above the edge of two facets is above both, to rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Entry:
    """The deepest entry of a foundation between the nodes of Gamma_C; zeros if it does not enter.

    - ``depth``, ``place``: a length, and the point (d,) before the body moved
    - ``share``: the depth over the indentation.  This is how far the foundation would enter there,
      or does enter at a node, without contact, with the largest displacement of the body along the
      normal of the facet; it is at least 1e-4 of the largest displacement
    - ``missed``: the share of the deepest entry with no touching node nearby that has half of the
      indentation
    - ``places``: the deepest of each facet with an entry by more than 10 % of the indentation
    """

    depth: float = 0.0
    share: float = 0.0
    place: tuple[float, ...] = ()
    missed: float = 0.0
    places: tuple[tuple[float, ...], ...] = ()


def entry_between_nodes(contact: NodalContact, u: fem.Function, touches: BoolArray) -> Entry:
    """The deepest entry of a contact for a displacement; collective.

    ``touches`` (k,) marks the owned nodes of Gamma_C where the body touches.
    """
    facets, comm = _Facets(contact, u, touches), contact.surface.domain.comm
    weights, depths = facets.search()
    behind, above = facets.corners_behind()
    deeper = above > depths
    depths, weights[deeper] = np.maximum(depths, above), behind[deeper]
    number = int(np.argmax(depths)) if len(depths) else -1
    deepest: tuple[float, list[float]] = (0.0, [])
    if number >= 0 and depths[number] > 0.0:
        deepest = float(depths[number]), facets.place(number, weights[number])
    of_ranks = comm.allgather(deepest)
    depth, place = max(of_ranks)
    if depth <= maximum(comm, facets.rounding):
        return Entry()
    rank = of_ranks.index((depth, place))
    direction, along = comm.bcast(
        facets.motion(number, weights[number]) if comm.rank == rank else None, rank
    )
    moved = float(maximum(comm, u.x.array.reshape(-1, contact.surface.domain.dim) @ direction))
    overlap = max(depth - along, maximum(comm, -contact.gaps, -np.inf))
    largest = maximum(comm, np.abs(u.x.array))
    indentation = max(depth, moved + overlap, _LEAST * largest)
    is_missed = moved + facets.overlap_nearby(touches) < _SEEN * indentation
    missed = maximum(comm, depths[is_missed])
    notable = [
        tuple(facets.place(i, weights[i])) for i in np.flatnonzero(depths > NOTABLE * indentation)
    ]
    places = {at for of_rank in comm.allgather(notable) for at in of_rank}
    return Entry(
        depth, depth / indentation, tuple(place), missed / indentation, tuple(sorted(places))
    )


class _Facets:
    """The facets of Gamma_C of this rank, moved by u, with the values at their nodes.

    A quadrilateral counts as two triangles, with its own functions in each.  Barycentric
    coordinates of points of the facets are (m, q, d), for q points of each of m facets.
    """

    def __init__(self, contact: NodalContact, u: fem.Function, touches: BoolArray) -> None:
        surface = contact.surface
        self._contact, self._dim = contact, surface.domain.dim
        dim, degree = self._dim, surface.degree
        self._kind = surface.domain.kind.facet.name, degree
        halves = _HALVES[self._kind]
        nodes = np.concatenate([surface.facet_nodes[:, list(half)] for half in halves])
        blocks = surface.controls.blocks[nodes]
        self._x = surface.scalar_space.tabulate_dof_coordinates()[nodes, :dim]
        self._u = u.x.array.reshape(-1, dim)[blocks]
        normals = surface.vector_function(contact.normals).x.array.reshape(-1, dim)[blocks]
        self._u_normal = np.sum(self._u * normals, axis=2)
        #: The displacement relative to a foundation that forces have moved.
        self._past = self._u - contact.travel
        self._moved = self._x[:, :dim] + self._past[:, :dim]
        self._outward = _outward(surface, self._x[:, :dim], len(halves))
        away = self._moved - self._moved.mean(axis=1, keepdims=True)
        self._radius = np.linalg.norm(away, axis=2).max(axis=1, initial=0.0)
        eye = np.eye(dim)[None].repeat(len(nodes), axis=0)
        self._at_corners = np.maximum(self._depth(eye, np.arange(len(nodes))), 0.0)
        self._known = np.maximum(
            self._known_curvature(normals[:, :dim], nodes[:, :dim], touches), self._chords(blocks)
        )

    @property
    def rounding(self) -> FloatArray:
        """The rounding of depths that are distances, by the digits of points; 0 for gaps."""
        known = self._moved if self._contact.foundation.is_distance else np.zeros(1)
        return ROUNDING * np.abs(known).reshape(-1)

    def place(self, number: int, weights: FloatArray) -> list[float]:
        """The point (d,) of a facet before the body moved."""
        return list(map(float, self._basis(weights[None, None])[0, 0] @ self._x[number]))

    def motion(self, number: int, weights: FloatArray) -> tuple[FloatArray, float]:
        """The outward normal (d,) of a facet, and the displacement along it at a point."""
        normal = self._outward[number]
        return normal, float(self._basis(weights[None, None])[0, 0] @ self._u[number] @ normal)

    def search(self) -> tuple[FloatArray, FloatArray]:
        """The barycentric coordinates (m, d) of the deepest points, and the depths (m,).

        The depths are those beyond the depths at the corners.  Collective.
        """
        dim, count = self._dim, len(self._x)
        parts = _DIVISIONS[dim]
        lattice = np.array(
            [p for p in itertools.product(range(parts + 1), repeat=dim) if sum(p) == parts]
        )
        points = (lattice / parts)[None].repeat(count, axis=0)
        obstacle = self._contact.foundation
        near: IntArray = np.arange(count)
        if obstacle.is_distance:
            # The distance changes by no more than the way.
            centres = self._basis(np.full((count, 1, dim), 1.0 / dim))[:, 0]
            middles = np.einsum("mn,mni->im", centres, self._x + self._past)
            distances = obstacle.distance(middles)
            near = np.flatnonzero(distances < 2.0 * self._radius)
        best, deepest = self._best(points[near], near)
        ways = [np.eye(dim)[i] - np.eye(dim)[j] for i, j in itertools.permutations(range(dim), 2)]
        for halving in range(1, _HALVINGS + 1):
            steps = np.array([np.zeros(dim), *ways]) / (parts * 2.0**halving)
            around = np.maximum(best[:, None] + steps, 0.0)
            around /= around.sum(axis=2, keepdims=True)
            best, deepest = self._best(around, near)
        weights, excess = np.full((count, dim), 1.0 / dim), np.zeros(count)
        weights[near], excess[near] = best, deepest - self._known[near]
        return weights, excess

    def corners_behind(self) -> tuple[FloatArray, FloatArray]:
        """The corners of the foundation deepest behind the facets; collective.

        Returns the barycentric coordinates (m, d) of the points above the corners, and the depths
        (m,), 0 without a corner.
        """
        from scipy.spatial import cKDTree

        foundation, centres = self._contact.foundation, self._moved.mean(axis=1)
        count, dim, reach = len(centres), self._dim, _REACH * self._radius
        ends = centres - reach[:, None], centres + reach[:, None]
        box = np.stack([ends[0].min(axis=0, initial=np.inf), ends[1].max(axis=0, initial=-np.inf)])
        corners = foundation.corners(box, _SPACING * self._radius.min(initial=np.inf))
        depths, weights = np.zeros(count), np.full((count, dim), 1.0 / dim)
        near: list[list[int]] = [[]] * count
        if len(corners) and count:
            near = cKDTree(corners).query_ball_point(centres, reach)
        # The pairs of a facet and a corner.
        facet = np.repeat(np.arange(count), [len(some) for some in near])
        away = corners[np.concatenate([np.zeros(0, dtype=int), *near]).astype(int)]
        away = away - self._moved[facet, 0]
        inverse = np.linalg.pinv((self._moved[:, 1:] - self._moved[:, :1]).transpose(0, 2, 1))
        others = np.einsum("pij,pj->pi", inverse[facet], away)
        shares = np.concatenate([1.0 - others.sum(axis=1, keepdims=True), others], axis=1)
        normals = facet_normals(self._moved)
        normals *= np.sign(np.sum(normals * self._outward, axis=1))[:, None]
        normals /= np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)[:, None]
        # Above a corner the facet of a quadratic displacement is off its plane.
        moved = self._x + self._past
        bulge = np.einsum("pn,pni->pi", self._basis(shares), moved[facet])
        bulge -= np.einsum("pd,pdi->pi", shares, self._moved[facet])
        behind = np.sum((bulge - away) * normals[facet], axis=1)
        behind[shares.min(axis=1, initial=1.0) < -_ROUNDING] = 0.0
        # The deepest comes last.
        order = np.argsort(behind, kind="stable")
        depths[facet[order]], weights[facet[order]] = behind[order], shares[order]
        points = np.einsum("mn,mni->im", self._basis(weights), moved)
        above = foundation.distance(points)
        depths -= np.sum(weights * self._at_corners, axis=1) + self._known
        # The point above a corner may be on the side of the tool, to rounding.
        depths[above > _ROUNDING * self._radius] = 0.0
        return weights, depths

    def overlap_nearby(self, touches: BoolArray) -> FloatArray:
        """The largest overlap (m,) of the nodes that touch (k,) around each facet; collective.

        It is -inf where no node around touches.
        """
        from scipy.spatial import cKDTree

        contact, count = self._contact, len(self._x)
        comm = contact.surface.domain.comm
        points = np.concatenate(comm.allgather(contact.surface.points[touches]))
        overlaps = np.concatenate(comm.allgather(-contact.gaps[touches]))
        largest = np.full(count, -np.inf)
        if len(points) and count:
            middles = self._x[:, : self._dim].mean(axis=1)
            near = cKDTree(points).query_ball_point(middles, _AROUND * self._radius)
            largest[:] = [max(overlaps[some], default=-np.inf) for some in near]
        return largest

    def _best(self, weights: FloatArray, facets: IntArray) -> tuple[FloatArray, FloatArray]:
        """The deepest (m, d) of points (m, q, d) of m facets, and its depth (m,)."""
        at_corners = np.einsum("mqd,md->mq", weights, self._at_corners[facets])
        excess = self._depth(weights, facets) - at_corners
        best = np.argmax(excess, axis=1)
        rows = np.arange(len(best))
        return weights[rows, best], excess[rows, best]

    def _depth(self, weights: FloatArray, facets: IntArray) -> FloatArray:
        """``-phi`` or ``u_nu - gap`` (m, q) at points (m, q, d) of m facets; collective."""
        shape, basis = weights.shape[:2], self._basis(weights)

        def of(values: FloatArray) -> FloatArray:
            at_points = np.einsum("mqn,mni->imq", basis, values[facets])
            return at_points.reshape(len(at_points), -1)

        u_normal, moved = of(self._u_normal[:, :, None])[0], of(self._x + self._past)
        return -self._contact.foundation.opening(of(self._x), u_normal, moved).reshape(shape)

    def _basis(self, weights: FloatArray) -> FloatArray:
        """The nodal functions (m, q, n) of a facet at points (m, q, d)."""
        points = weights[..., 1:].reshape(-1, self._dim - 1)
        functions = nodal_functions(*self._kind, points)
        return functions.reshape(*weights.shape[:-1], functions.shape[1])

    def _known_curvature(
        self, normals: FloatArray, corners: IndexArray, touches: BoolArray
    ) -> FloatArray:
        """How far (m,) a foundation may enter facets all of whose corners touch it.

        Between the corners of a facet of length h, where the normals of the foundation turn by an
        angle a, it enters by ``h a/8`` if it is round, and by up to ``h a/4`` if it has an edge.
        This is the error of the mesh of a body that follows the foundation.
        """
        surface = self._contact.surface
        marks = surface.scalar_function(touches.astype(float)).x.array[corners]
        known = np.zeros(len(corners))
        for i, j in itertools.combinations(range(self._dim), 2):
            turn = np.linalg.norm(normals[:, i] - normals[:, j], axis=1)
            length = np.linalg.norm(self._x[:, i] - self._x[:, j], axis=1)
            known = np.maximum(known, np.where(turn < _KNOWN, 0.25 * length * turn, 0.0))
        return np.where(marks.min(axis=1, initial=1.0) > 0.0, known, 0.0)

    def _chords(self, blocks: IndexArray) -> FloatArray:
        """How far (m,) facets are in front of a hollow boundary that they are chords of.

        An edge of length h, along which the averaged normal of the body turns by a, is in front of
        the arc by ``h a/8``, and the middle of a triangle by 4/3 of that.  At the rim, where the
        normal is that of the last facet, the other end knows the turn.
        """
        surface, dim = self._contact.surface, self._dim
        normals = surface.vector_function(surface.body_normals).x.array.reshape(-1, dim)
        known = np.zeros(len(blocks))
        for i, j in itertools.permutations(range(dim), 2):
            edges = self._x[:, j] - self._x[:, i]
            # Half of the turn, times the length.
            hollow = np.sum(normals[blocks[:, i]] * edges, axis=1)
            is_smooth = hollow < CORNER * np.linalg.norm(edges, axis=1)
            known = np.maximum(known, np.where(is_smooth, hollow / 3.0, 0.0))
        return known


def _outward(surface: ContactSurface, corners: FloatArray, parts: int) -> FloatArray:
    """The outward unit normals (m, d) of parts of facets with the corners (m, d, d) at rest.

    There are as many parts of each facet, those of one number together.
    """
    domain = surface.domain
    cells = _compat.cell_corners(domain.mesh)[np.tile(domain.owners(surface.facets), parts)]
    inside = domain.mesh.geometry.x[cells][:, :, : domain.dim].mean(axis=1)
    normals = unit_normals(corners)
    side = np.sum(normals * (corners[:, 0] - inside), axis=1)
    return np.asarray(normals * np.sign(side)[:, None])


# Of the extent of the body.
_FLAT = 1e-9


def uncovered_entry(
    domain: Domain, u: fem.Function, contact: NodalContact
) -> tuple[float, tuple[float, ...]]:
    """How deep the boundary outside of a contact's part of Gamma_C enters its foundation.

    Returns the depth, a length at the nodes of the moved boundary ``x + u(x)``, and the place (d,)
    before the body moved.  Where a half space presses on a part of a flat side, the other parts of
    that side are left out.  Collective.
    """
    dim, space = domain.dim, u.function_space
    exterior = dmesh.exterior_facet_indices(domain.mesh.topology)
    nodes = np.setdiff1d(
        fem.locate_dofs_topological(space, dim - 1, exterior),
        fem.locate_dofs_topological(space, dim - 1, contact.surface.facets),
    )
    nodes = nodes[nodes < space.dofmap.index_map.size_local]
    places = space.tabulate_dof_coordinates()[nodes, :dim]
    if contact.foundation.is_plane:
        # A flat punch is a half space that ends where the part of the flat side ends.
        apart = ~_on_flat_side(domain, contact, places)
        nodes, places = nodes[apart], places[apart]
    moved = places + u.x.array.reshape(-1, dim)[nodes]
    # A foundation that a force has moved is entered like one at rest by a body that moved back.
    depths = np.maximum(-contact.foundation.distance((moved - contact.travel).T), 0.0)
    depth, place = peak(domain.comm, depths, places)
    return depth, tuple(place or ())


def _on_flat_side(domain: Domain, contact: NodalContact, places: FloatArray) -> BoolArray:
    """Which places (k, d) lie in the plane of one contact's part of Gamma_C if it is flat."""
    normals, points = contact.surface.body_normals, contact.surface.points
    first = [(normals[0], points[0])] if len(points) else []
    normal, point = next(pair for pairs in domain.comm.allgather(first) for pair in pairs)
    near = _FLAT * domain.extent
    heights = np.abs((points - point) @ normal)
    if maximum(domain.comm, heights) > near:
        return np.zeros(len(places), dtype=bool)
    return np.asarray(np.abs((places - point) @ normal) <= near)
