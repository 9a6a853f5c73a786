"""One side of an interface between bodies as Gamma_C, and the other side that it faces."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from scipy.sparse import csr_matrix, diags

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.contact.contact import Contact
from contact_locking.contact.pairing import Pairing, Side, pair
from contact_locking.contact.surface import PRESCRIBED, ContactSurface
from contact_locking.errors import InputError, Misplaced
from contact_locking.fem.facet_nodes import facet_nodes
from contact_locking.fem.jump import JumpValues
from contact_locking.fem.spaces import Element
from contact_locking.laws.kinematics import WeightedMeasure
from contact_locking.mesh.domain import Domain
from contact_locking.supports.conditions import Constraints

# An overlap that is deeper than this share of the thinnest extent of the bodies is a mistake.
_DEEPEST = 0.1
# Side 1 should not be coarser than side 2 by more than this factor.
_COARSER = 3.0


class PairedSurface(ContactSurface):
    """Gamma_C of a body that faces another side, ``against``, by jumps at its nodes.

    If ``against`` has the names of ``on``, the bodies that have these parts touch each other.
    The weights are those of the part that side 2 covers, and ``distance`` (k,) is the gap between
    the sides, the extent of the body where a node faces nothing.  All ranks find the whole pairing.
    Raises InputError for sides that have nodes in common, for sides that do not face each other or
    overlap too deep, and for hexahedra.  The constructor is collective.
    """

    def __init__(
        self, domain: Domain, space: fem.FunctionSpace, given: Contact, element: Element
    ) -> None:
        key, names = given.key, tuple(given.against or ())
        if not domain.kind.facet.is_simplex:
            raise InputError(
                f"bodies that touch each other are not there for {domain.kind.plural}; take "
                "simplices",
                key,
            )
        if element.curved:
            raise InputError(
                "bodies that touch each other are not there for curved cells, as the sides are cut "
                "into straight pieces; take mesh.curved: false",
                key,
            )
        super().__init__(domain, space, given.on, f"{key}.on", element, space)
        other = domain.facets(names, f"{key}.against")
        among = set(given.on) == set(names)
        one, mine = _side(domain, space, self.facets, among)
        two, theirs = _side(domain, space, other, among)
        at_tip = np.isin(mine, theirs) & (not among)
        if not among:
            _require_apart(domain, one, two, mine, theirs, given)
        found = pair(one, two)
        _require_facing(domain, one, found, given)
        index_map = space.dofmap.index_map
        here = np.searchsorted(mine, index_map.local_to_global(self.blocks))
        faces = (found.faces & ~at_tip)[here]
        own = self.limited.by_blocks
        shares = found.shares[here].tocsr()
        facing = csr_matrix((shares.data, theirs[shares.indices], shares.indptr), shape=own.shape)
        rows = diags(faces.astype(float)) @ (own - facing)
        rows.eliminate_zeros()
        vector_blocks = self.limited.blocks
        self._jump = JumpValues(
            element.trace, self.scalar_space, space, self.nodes, vector_blocks, rows
        )
        self.limited = self._jump
        self.distance = np.where(faces, found.gap[here], domain.extent)
        weights = np.where(faces, found.weights[here], self.weights)
        self.ds = WeightedMeasure(self.ds, self.scalar_function(weights / self.weights))
        self.weights = weights
        self._coarser = float(np.median(one.sizes()) / np.median(two.sizes()))
        self._key, self._blocks = key, np.union1d(mine, theirs)

    def limited_gap(self, gap: FloatArray) -> FloatArray:
        """That of the given part of the gap: :attr:`distance` has limited values."""
        return super().limited_gap(gap - self.distance) + self.distance

    @property
    def jump(self) -> JumpValues:
        return self._jump

    def free_nodes(self, normal: FloatArray, constraints: Constraints) -> BoolArray:
        """(k,) the nodes that face the other side where conditions leave a part of the jump free.

        ``normal`` (k, d) is the contact normal; collective.
        """
        dim, index_map = self.domain.dim, self.vector_space.dofmap.index_map
        low, high = index_map.local_range
        own = self._blocks[(self._blocks >= low) & (self._blocks < high)] - low
        # The projections to the free directions at the nodes of both sides.
        axes = [constraints.free_part(np.tile(axis, high - low)) for axis in np.eye(dim)]
        local = np.stack([values.reshape(-1, dim)[own] for values in axes], axis=1)
        projections = np.concatenate(self.domain.comm.allgather(local))
        rows = self._jump.by_blocks.tocoo()
        at = projections[np.searchsorted(self._blocks, rows.col)]
        parts = rows.data[:, None] * np.einsum("eai,ea->ei", at, normal[rows.row])
        sizes = np.bincount(rows.row, np.sum(parts**2, axis=1), len(normal))
        return np.sqrt(sizes) > PRESCRIBED

    def warnings(self) -> list[str]:
        ratio = self._coarser ** (1.0 / (self.domain.dim - 1))
        if ratio <= _COARSER:
            return []
        return [
            f"{self._key}: the facets of on are {ratio:.2g} times as long as those of against; the "
            "conditions of contact hold at the nodes of on: let the finer side be on"
        ]


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
    outward = _outward(x[nodes[:, :dim]], inside)
    numbers = index_map.local_to_global(nodes.reshape(-1)).reshape(nodes.shape)
    every = np.concatenate(comm.allgather(numbers))
    points = np.concatenate(comm.allgather(x[nodes]))
    blocks, first, inverse = np.unique(every, return_index=True, return_inverse=True)
    return (
        Side(
            points.reshape(-1, dim)[first],
            inverse.reshape(-1, nodes.shape[1]),
            np.concatenate(comm.allgather(outward)),
            np.concatenate(comm.allgather(domain.parts[cells])) if among else None,
            domain.axisymmetric,
        ),
        blocks,
    )


def _outward(corners: FloatArray, inside: FloatArray) -> FloatArray:
    """The unit normals (m, d) of facets (m, d, d) that point away from ``inside`` (m, d)."""
    edges = corners[:, 1:] - corners[:, :1]
    if corners.shape[2] == 2:
        normals = np.stack([edges[:, 0, 1], -edges[:, 0, 0]], axis=1)
    else:
        normals = np.asarray(np.cross(edges[:, 0], edges[:, 1]), dtype=float)
    side = np.sign(np.sum(normals * (corners[:, 0] - inside), axis=1))
    return np.asarray(side[:, None] * normals / np.linalg.norm(normals, axis=1)[:, None])


def _require_apart(
    domain: Domain, one: Side, two: Side, mine: IntArray, theirs: IntArray, given: Contact
) -> None:
    """Raise InputError for sides that have a facet in common; a crack has a node at its tip."""
    both = np.isin(mine, theirs)
    shared = both[one.facets].all(axis=1)
    if not shared.any():
        return
    where = domain.where(one.corners[np.argmax(shared)].mean(axis=0))
    raise InputError(
        f"{', '.join(given.on)} and {', '.join(given.against or ())} share the nodes of "
        f"{int(shared.sum())} facets, as at {where}: bodies that touch each other have nodes of "
        "their own there",
        f"{given.key}.against",
    )


def _require_facing(domain: Domain, one: Side, found: Pairing, given: Contact) -> None:
    """Raise InputError for sides that do not face each other, or not once, or overlap too deep."""
    key, on, against = given.key, ", ".join(given.on), ", ".join(given.against or ())
    if not found.faces.any():
        where = domain.where(one.points.mean(axis=0))
        raise InputError(
            f"the outward normals of {on}, around {where}, meet no facet of {against} that faces "
            "them; name the two parts that will touch each other",
            f"{key}.against",
        )
    if found.twice is not None:
        raise InputError(
            f"the outward normal of {on} at {domain.where(found.twice)} meets several facets of "
            f"{against}; name only the part of the other body that faces {on}",
            f"{key}.against",
        )
    low, high = domain.bounding_box
    deepest = int(np.argmin(found.gap))
    depth = -float(found.gap[deepest])
    if depth > _DEEPEST * float((high - low).min()):
        raise Misplaced(
            f"{on} reaches {depth:.4g} deep into {against} at "
            f"{domain.where(one.points[deepest])}: displacements are small, and so must overlaps "
            "be",
            f"{key}.against",
        )
