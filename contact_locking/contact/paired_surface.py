"""Side 1 of an interface between bodies as Gamma_C, and side 2 that it faces.

:func:`distances_apart` says how far two bodies that touch are from touching, by the geometry of
their displaced facets alone.  The distance of a point x of one side to the facets of the other is
``|x - y|`` with the nearest point y, negative inside of the other body, where ``(x - y) . n < 0``
with the outward normal n of the facet of y.  It counts where y lies inside of the facet.  Points
are the nodes of side 1 that press, which should be at the distance zero, and a lattice on the
facets of both sides, which should not be inside.  The pressure of a quadratic node between corners
belongs to a control value and acts on the whole facet: of the nodes of its facets the nearest
should be at zero.  Distances up to the sagittae ``l theta/8`` of the chords do not count: the
facets of a round side, of length l, turn by theta from one to the next.  Of points inside, the
sagitta of their own side does not count either, but where no node of side 1 presses beside: there
it has missed the other side, and no force acts.  Nothing of this is shared with the gap, the
pairing and the normals of the contact conditions.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from dolfinx import fem
from scipy.sparse import coo_matrix, csr_matrix, diags, vstack
from scipy.spatial import cKDTree

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.contact.contact import Contact
from contact_locking.contact.pairing import Pairing, Side, pair
from contact_locking.contact.surface import PRESCRIBED, ContactSurface, Frame
from contact_locking.errors import InputError, Misplaced
from contact_locking.fem.contact_operator import ContactOperator
from contact_locking.fem.spaces import Element, facet_nodes
from contact_locking.findings import Finding
from contact_locking.mesh.data import unit_normals
from contact_locking.mesh.domain import Domain
from contact_locking.supports.conditions import Constraints

# The nearest point of a side is looked for in the facets with this many nearest middles.
_NEAREST = 8
# The same where the body of the point has facets in the side as well.
_NEAREST_OF_ALL = 32
# The parts of each edge of a facet in the lattice.
_DIVISIONS = 4
# A point faces a facet if the line to it is along the normal of the facet, up to this cosine.
_ALONG = 0.99


def distances_apart(
    presses: BoolArray, first: Side, second: Side, offset: float
) -> tuple[FloatArray, FloatArray]:
    """The distances (q,) by which sides miss each other, and the normals (q, d) of facets there.

    The sides are displaced, and ``presses`` (k,) marks the nodes of side 1 that press.  ``offset``
    is the gap that adds to the distance of the sides.
    """
    of_node = np.zeros(len(first.points), dtype=np.int64)
    of_node[first.facets] = np.arange(len(first.facets))[:, None]
    distance, sagitta, nearest = _distances_to(first.points, first, of_node, second)
    away = np.abs(distance + offset) - sagitta
    lengths = [_least_of_facets(away, first)[presses]]
    normals = [second.outward[nearest][presses]]
    bears: BoolArray = np.any(presses[first.facets], axis=1)
    for side, facing in ((first, second), (second, first)):
        points, facet = _lattice(side)
        distance, sagitta, nearest = _distances_to(points, side, facet, facing)
        own_sagitta = np.where(
            bears[facet if side is first else nearest], _sagittae(side)[facet], 0.0
        )
        lengths.append(-(distance + offset) - sagitta - own_sagitta)
        normals.append(facing.outward[nearest])
    return np.concatenate(lengths), np.concatenate(normals)


def _least_of_facets(away: FloatArray, side: Side) -> FloatArray:
    """The values (k,) at the nodes; between corners the least one of the nodes of the facets.

    A node that faces nothing has -inf, and is not the least one beside others.
    """
    values, corners = away.copy(), side.kind.corners
    least = np.where(np.isfinite(away), away, np.inf)[side.facets].min(axis=1)
    between = side.facets[:, corners:]
    np.minimum.at(values, between, np.broadcast_to(least[:, None], between.shape))
    return values


def _distances_to(
    points: FloatArray, of: Side, at: IntArray, side: Side
) -> tuple[FloatArray, FloatArray, IntArray]:
    """The distances (k,) of points (k, d) to a side, the sagittae (k,) there, and the facets (k,).

    The points are those of facets ``at`` (k,) of the side ``of``.  The sagitta is inf, so that
    nothing counts, where a point faces no facet of another body.
    """
    numbers = np.arange(side.facets[:, : side.kind.corners].size)
    pieces = side.kind.split(numbers.reshape(-1, side.kind.corners))
    corners = side.corners.reshape(-1, points.shape[1])[pieces]
    facet = np.repeat(np.arange(len(side.facets)), len(side.kind.simplices))
    among = of.bodies is not None and side.bodies is not None
    count = min(_NEAREST_OF_ALL if among else _NEAREST, len(corners))
    near = cKDTree(corners.mean(axis=1)).query(points, k=count)[1].reshape(len(points), count)
    edges = corners[near][:, :, 1:] - corners[near][:, :, :1]
    away = points[:, None] - corners[near][:, :, 0]
    gram = edges @ edges.transpose(0, 1, 3, 2)
    place = np.linalg.solve(gram, np.einsum("kfed,kfd->kfe", edges, away)[..., None])[..., 0]
    # The nearest point of a facet, with coordinates that are cut off at its edges.
    place = np.clip(place, 0.0, 1.0)
    place = place / np.maximum(place.sum(axis=2, keepdims=True), 1.0)
    way = away - np.einsum("kfe,kfed->kfd", place, edges)
    size = np.linalg.norm(way, axis=2)
    if of.bodies is not None and side.bodies is not None:
        size[side.bodies[facet[near]] == of.bodies[at][:, None]] = np.inf
    best = np.argmin(size, axis=1)
    every = np.arange(len(points))
    nearest, length = facet[near[every, best]], size[every, best]
    along = np.sum(way[every, best] * side.outward[nearest], axis=1)
    extent = np.linalg.norm(edges[every, best], axis=2).max(axis=1)
    faces = np.isfinite(length) & (np.abs(along) >= _ALONG * length) & (length < extent)
    sagitta = np.where(faces, _sagittae(side)[nearest], np.inf)
    return np.sign(along) * length, sagitta, nearest


def _lattice(side: Side) -> tuple[FloatArray, IntArray]:
    """Points (q, d) of all facets, corners included, and the facet (q,) of each."""
    steps = np.linspace(0.0, 1.0, _DIVISIONS + 1)
    grid = np.stack(np.meshgrid(*[steps] * side.kind.dim), axis=-1).reshape(-1, side.kind.dim)
    if side.kind.is_simplex:
        grid = grid[grid.sum(axis=1) <= 1.0 + 1e-9]
    points = np.einsum("qc,mcd->mqd", side.kind.basis(grid), side.corners)
    return points.reshape(-1, points.shape[2]), np.repeat(np.arange(len(points)), len(grid))


def _sagittae(side: Side) -> FloatArray:
    """The largest heights (m,) of a round side above its facets.

    In 2D the angle is the smaller one of those to both neighbours: a flat facet beside a fillet has
    no sagitta.  In 3D it is the angle between the averaged normals, doubled, as these turn by half
    of it at the rim.
    """
    if side.kind.dim == 1:
        return np.asarray(side.sizes() * _turns(side) / 8.0)
    normals = side.nodal_normals()[side.facets[:, : side.kind.corners]]
    heights = np.zeros(len(side.facets))
    for i, j in combinations(range(side.kind.corners), 2):
        along = side.corners[:, j] - side.corners[:, i]
        turn = np.sum((normals[:, j] - normals[:, i]) * along, axis=1)
        heights = np.maximum(heights, 2.0 * np.abs(turn) / 8.0)
    return heights


def _turns(side: Side) -> FloatArray:
    """(m,) the smaller angle of each segment to its two neighbours, 0 without one."""
    at = side.facets[:, :2].reshape(-1)
    order = np.argsort(at, kind="stable")
    pairs = np.flatnonzero(np.diff(at[order]) == 0)
    first, other = order[pairs] // 2, order[pairs + 1] // 2
    cosine = np.sum(side.outward[first] * side.outward[other], axis=1)
    turns = np.full(2 * len(side.facets), np.inf)
    angles = np.arccos(np.clip(cosine, -1.0, 1.0))
    turns[order[pairs]], turns[order[pairs + 1]] = angles, angles
    least = turns.reshape(-1, 2).min(axis=1)
    return np.where(np.isfinite(least), least, 0.0)


# An overlap that is deeper than this share of the thinnest extent of the bodies is a mistake.
_DEEPEST = 0.1
# Displacements that are less than this share of the extent are rounding.
_ROUNDING = 1e-12
# Side 1 should not be coarser than side 2 by more than this factor.
_COARSER = 3.0


class PairedSurface(ContactSurface):
    """Gamma_C of a body that faces another side, ``against``, by jumps at its nodes.

    If ``against`` has the names of ``on``, the bodies that have these parts touch each other.
    The weights are those of the part that side 2 covers, and ``distance`` (k,) is the gap between
    the sides, the extent of the body where a node faces nothing.  All ranks find the whole pairing.
    Where the sides are paired at a displacement w, ``distance`` is what the jump may reach in all:
    ``g + [w]_nu`` with the gap g between the displaced sides.
    Raises InputError for sides that have nodes in common, and for sides that do not face each other
    or overlap too deep.  The constructor is collective.
    """

    is_paired = True

    def __init__(
        self, domain: Domain, space: fem.FunctionSpace, contact: Contact, element: Element
    ) -> None:
        key, names = contact.key, tuple(contact.against or ())
        super().__init__(domain, space, contact.on, f"{key}.on", element)
        other = domain.facets(names, f"{key}.against")
        among = set(contact.on) == set(names)
        self._first, self._mine = _side(domain, space, self.facets, among)
        self._second, self._theirs = _side(domain, space, other, among)
        self.facing_length = float(np.median(self._second.sizes())) ** (1.0 / (domain.dim - 1))
        self._at_tip = np.isin(self._mine, self._theirs) & (not among)
        if not among:
            _require_apart(domain, self._first, self._second, self._mine, self._theirs, contact)
        self._contact, self._key = contact, key
        self._blocks = np.union1d(self._mine, self._theirs)
        blocks = space.dofmap.index_map.local_to_global(self.blocks)
        self._positions = np.searchsorted(self._mine, blocks)
        # The coefficients of side 1 on all ranks, in the order of its points.
        order = np.argsort(np.concatenate(domain.comm.allgather(blocks)))
        self._coefficients = vstack(domain.comm.allgather(self.controls.rows)).tocsr()[order]
        self._whole = self.weights
        frame = self.frame_at(None)
        self.operator = ContactOperator(space, frame.rows, couples_cells=True)
        self.set_frame(frame)

    def sides_at(self, displacement: FloatArray | None) -> tuple[Side, Side]:
        """Both sides at a displacement (local values), None for rest; collective."""
        if displacement is None:
            return self._first, self._second
        u_1, u_2 = (self._at_blocks(displacement, blocks) for blocks in (self._mine, self._theirs))
        return self._first.moved(u_1), self._second.moved(u_2)

    def frame_at(self, displacement: FloatArray | None, must_face: bool = True) -> Frame:
        mine, domain = self._positions, self.domain
        first, second = self.sides_at(displacement)
        pairing = pair(first, second)
        if must_face:
            _require_facing(domain, first, second, pairing, self._contact, displacement is not None)
        faces, coefficients = (pairing.faces & ~self._at_tip)[mine], self._coefficients
        shares = pairing.shares[mine].tocsr()
        columns = self._theirs[shares.indices]
        shape = (len(mine), coefficients.shape[1])
        facing = csr_matrix((shares.data, columns, shares.indptr), shape=shape)
        rows = diags(faces.astype(float)) @ (pairing.near[mine] @ coefficients - facing)
        rows.eliminate_zeros()
        return Frame(
            displacement,
            rows.tocsr(),
            faces,
            pairing.normals[mine],
            np.where(faces, pairing.gap[mine], domain.extent),
            np.where(faces, pairing.weights[mine], self._whole),
            np.where(faces, pairing.weights[mine] / self._whole, 1.0),
        )

    def set_frame(self, frame: Frame) -> None:
        self.frame, self.weights = frame, frame.weights
        self.body_normals = frame.normals
        self.operator.join(frame.rows)
        self.distance = frame.distance
        if frame.displacement is not None:
            before = self.operator.values(frame.displacement)
            self.distance = frame.distance + np.sum(before * frame.normals, axis=1)

    def apart(
        self, displacement: FloatArray, presses: BoolArray, gap: FloatArray, entered: float
    ) -> float:
        """How far the sides are from touching at a displacement (local values); collective.

        It is the largest length of :func:`distances_apart` less ``entered``, by which penalties let
        them enter, as a share of what displacements differ by along the normal.  ``presses`` (k,)
        marks the nodes that press, and ``gap`` (k,) is that of the laws.
        """
        comm, sides = self.domain.comm, self.sides_at(displacement)
        pressing = np.concatenate(comm.allgather(self._positions[presses]))
        # The gap that adds to the distance of the sides.
        at = presses if len(pressing) or self.frame is None else self.frame.faces
        offsets = np.concatenate(comm.allgather((gap - self.distance)[at]))
        offset = float(np.median(offsets)) if len(offsets) else 0.0
        lengths, normals = distances_apart(
            np.isin(np.arange(len(sides[0].points)), pressing), *sides, offset
        )
        counts = lengths > entered
        sizes = self.extents(displacement, normals[counts])
        sizes += abs(offset) + _ROUNDING * self.domain.extent
        return float(np.max((lengths[counts] - entered) / sizes, initial=0.0))

    def _at_blocks(self, displacement: FloatArray, blocks: IntArray) -> FloatArray:
        """The displacement (k, d) at global blocks (k,), from local values; collective."""
        low, high = self.vector_space.dofmap.index_map.local_range
        local_blocks = blocks[(blocks >= low) & (blocks < high)] - low
        local = displacement.reshape(-1, self.domain.dim)[local_blocks]
        return np.concatenate(self.domain.comm.allgather(local))

    def limited_gap(self, gap: FloatArray) -> FloatArray:
        """That of the given part of the gap: :attr:`distance` has limited values."""
        return super().limited_gap(gap - self.distance) + self.distance

    def of_motion(self, motion: FloatArray) -> FloatArray:
        return self.operator.values(motion)

    def free_nodes(self, normal: FloatArray, constraints: Constraints) -> BoolArray:
        """(k,) the nodes that face the other side where conditions leave a part of the jump free.

        ``normal`` (k, d) is the contact normal; collective.
        """
        freedom = self._freedom(constraints, self.operator.rows.tocoo())
        sizes = np.einsum("ki,kij,kj->k", normal, freedom, normal)
        return np.sqrt(np.maximum(sizes, 0.0)) > PRESCRIBED

    def sliding_nodes(self, constraints: Constraints) -> BoolArray:
        # The nodes of both sides that have the largest shares in the jump decide.
        rows = self.operator.rows.tocoo()
        order = np.lexsort((rows.data, rows.row))
        ends = np.diff(rows.row[order], prepend=-1, append=-1) != 0
        most = order[ends[:-1] | ends[1:]]
        main = coo_matrix((rows.data[most], (rows.row[most], rows.col[most])), shape=rows.shape)
        freedom = np.linalg.eigvalsh(self._freedom(constraints, main))
        return np.asarray(freedom[:, -2] > PRESCRIBED**2)

    def _freedom(self, constraints: Constraints, rows: coo_matrix) -> FloatArray:
        """The sums (k, d, d) of products of the directions that conditions leave a jump free in."""
        dim, index_map = self.domain.dim, self.vector_space.dofmap.index_map
        low, high = index_map.local_range
        # The projections to the free directions at the nodes of both sides.
        axes = [constraints.free_part(np.tile(axis, high - low)) for axis in np.eye(dim)]
        projections = np.stack([self._at_blocks(each, self._blocks) for each in axes], axis=1)
        at = projections[np.searchsorted(self._blocks, rows.col)]
        products = rows.data[:, None, None] ** 2 * (at @ at.transpose(0, 2, 1))
        sums = np.zeros((rows.shape[0], dim, dim))
        np.add.at(sums, rows.row, products)
        return sums

    def findings(self) -> list[Finding]:
        length = float(np.median(self._first.sizes())) ** (1.0 / (self.domain.dim - 1))
        ratio = length / self.facing_length
        if ratio <= _COARSER:
            return []
        on, against = (", ".join(x or ()) for x in (self._contact.on, self._contact.against))
        return [Finding("contact.coarser", self._key, on=on, against=against, ratio=ratio)]


def _side(
    domain: Domain, space: fem.FunctionSpace, facets: IndexArray, among: bool
) -> tuple[Side, IntArray]:
    """The side with the given local facets, and the global blocks (k,) of its points; collective.

    All ranks have the same side.  It knows its bodies if ``among`` these there is contact.
    """
    comm, dim = domain.comm, domain.dim
    mesh, index_map = domain.mesh, space.dofmap.index_map
    owned = mesh.topology.index_map(dim).size_local
    facets = facets[domain.owners(facets) < owned]
    cells = domain.owners(facets)
    nodes = facet_nodes(domain, space, facets, cells)
    x = space.tabulate_dof_coordinates()[:, :dim]
    inside = mesh.geometry.x[_compat.cell_corners(mesh)[cells]][:, :, :dim].mean(axis=1)
    corners = x[nodes[:, : domain.kind.facet.corners]]
    outward = unit_normals(corners)
    outward *= np.sign(np.sum(outward * (corners[:, 0] - inside), axis=1))[:, None]
    numbers = index_map.local_to_global(nodes.reshape(-1)).reshape(nodes.shape)
    every = np.concatenate(comm.allgather(numbers))
    points = np.concatenate(comm.allgather(x[nodes]))
    blocks, first, inverse = np.unique(every, return_index=True, return_inverse=True)
    return (
        Side(
            points.reshape(-1, dim)[first],
            domain.kind.facet,
            inverse.reshape(-1, nodes.shape[1]),
            np.concatenate(comm.allgather(outward)),
            np.concatenate(comm.allgather(domain.parts[cells])) if among else None,
            domain.axisymmetric,
        ),
        blocks,
    )


def _require_apart(
    domain: Domain, first: Side, second: Side, mine: IntArray, theirs: IntArray, contact: Contact
) -> None:
    """Raise InputError for sides that have a facet in common; a crack has a node at its tip."""
    both = np.isin(mine, theirs)
    shared = both[first.facets].all(axis=1)
    if not shared.any():
        return
    where = domain.where(first.corners[np.argmax(shared)].mean(axis=0))
    raise InputError(
        f"{', '.join(contact.on)} and {', '.join(contact.against or ())} share the nodes of "
        f"{int(shared.sum())} facets, as at {where}: bodies that touch each other have nodes of "
        "their own there",
        f"{contact.key}.against",
    )


def _require_facing(
    domain: Domain, first: Side, second: Side, pairing: Pairing, contact: Contact, is_moved: bool
) -> None:
    """Raise InputError for sides that do not face each other, or not once, or overlap too deep.

    Sides that have moved may do the last two on the way to a solution.
    """
    key, on, against = contact.key, ", ".join(contact.on), ", ".join(contact.against or ())
    if not pairing.faces.any():
        where = domain.where(first.points.mean(axis=0))
        behind = pair(first, replace(second, outward=-second.outward)).faces
        if behind.any():
            where = domain.where(first.points[np.argmax(behind)])
            raise Misplaced(
                f"the outward normals of {on} and {against} point the same way, as at {where}: "
                "one side sees the other from behind, or lies inside of its body; name the two "
                "sides that face each other, or move the bodies apart",
                f"{key}.against",
            )
        raise Misplaced(
            f"the outward normals of {on}, around {where}, meet no facet of {against} that faces "
            "them; name the two parts that will touch each other",
            f"{key}.against",
        )
    if is_moved:
        return
    if pairing.twice is not None:
        raise InputError(
            f"the outward normal of {on} at {domain.where(pairing.twice)} meets several facets of "
            f"{against}; name only the part of the other body that faces {on}",
            f"{key}.against",
        )
    deepest = int(np.argmin(pairing.gap))
    depth = -float(pairing.gap[deepest])
    if depth > _DEEPEST * float(np.ptp(domain.bounding_box, axis=0).min()):
        raise Misplaced(
            f"{on} reaches {depth:.4g} deep into {against} at "
            f"{domain.where(first.points[deepest])}: displacements are small, and so must overlaps "
            "be; move the bodies apart, or name the sides that face each other",
            f"{key}.against",
        )
