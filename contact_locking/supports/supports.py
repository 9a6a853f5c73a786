"""Supports along the normal of the boundary or along a given direction: ``u . m = value``."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.fem.trace import facet_nodes
from contact_locking.fields.clock import Clock
from contact_locking.fields.values import PresentValue
from contact_locking.mesh.cell_kind import CellKind
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.rank_sums import summed
from contact_locking.parallel import agree, maximum, on_any_rank, on_every_rank
from contact_locking.supports.support import Support


class HeldDirections:
    """The directions that are held at some nodes, with the displacements that they prescribe.

    At a node with the held directions m_1, ..., m_r (unit vectors, orthonormalised) let
    ``H = sum m_i m_i^T`` and ``P = I - H``, and let g be the displacement in the span of the
    directions that has the prescribed components.  Then ``u = P u + g``.  With the P of all nodes,
    the free part of a residual r is ``P r``, and the tangent A is replaced by ``P A P + s H`` with
    a stiffness s > 0 at each node, which is symmetric and, on the free displacements, the tangent
    itself.  For a direction along an axis these are the usual zero rows and columns with s on the
    diagonal.  Rounding in ``P A P`` couples the held directions with the free ones by a share of
    the stiffness of the node, which grows without bound where the node sticks to a foundation.  So
    s is the stiffness of the node itself.

    ``nodes`` (k,) are local nodes (blocks of the displacement space), ghosts included, of which the
    rank owns those below ``owned``.  ``held`` (k, d, d) are the projections H and ``values`` (k, d)
    the displacements g.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        nodes: IndexArray,
        owned: int,
        held: FloatArray,
    ) -> None:
        self.nodes, self.held = nodes, held
        self.values: FloatArray = np.zeros(held.shape[:2])
        self._comm, self._owned, self._mine = comm, owned, nodes < owned
        self._dim = held.shape[1]

    def project(self, values: FloatArray) -> None:
        """Take the held directions out of local or owned values of a displacement field."""
        blocks, held = self._of(values)
        nodal = values.reshape(-1, self._dim)
        nodal[blocks] -= np.einsum("kij,kj->ki", held, nodal[blocks])

    def part_of(self, values: FloatArray) -> FloatArray:
        """The components along held directions of local or owned values, and 0 elsewhere."""
        blocks, held = self._of(values)
        found = np.zeros_like(values)
        nodal = values.reshape(-1, self._dim)[blocks]
        found.reshape(-1, self._dim)[blocks] = np.einsum("kij,kj->ki", held, nodal)
        return found

    def apply(self, values: FloatArray) -> None:
        """Give local values the prescribed components along the held directions."""
        self.project(values)
        values.reshape(-1, self._dim)[self.nodes] += self.values

    def without(self, nodes: IndexArray) -> HeldDirections:
        """The same directions, but not at some local nodes."""
        kept = ~np.isin(self.nodes, nodes)
        found = HeldDirections(self._comm, self.nodes[kept], self._owned, self.held[kept])
        found.values = self.values[kept]
        return found

    def eliminate(self, matrix: PETSc.Mat, holds: bool = True) -> None:
        """Replace an assembled matrix A by ``P A P + s H``, or by ``P A P`` alone; collective.

        s is the largest entry on the diagonal of A at the node.  The pattern of the matrix is
        symmetric and has whole blocks of a node's components.
        """
        if not self._is_anywhere:
            return
        own, (first, _) = self.nodes[self._mine], matrix.getOwnershipRange()
        diagonal = matrix.getDiagonal()
        stiffness = diagonal.array_r.reshape(-1, self._dim)[own].max(axis=1)
        # PETSc multiplies matrices that are stored entry by entry.
        plain, projection = matrix.convert("aij", PETSc.Mat()), self._projection(matrix)
        projected = plain.PtAP(projection)
        projected.convert(matrix.getType())
        matrix.zeroEntries()
        matrix.axpy(1.0, projected, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        if holds:
            rows = (first // self._dim + own[:, None]).astype(PETSc.IntType)
            blocks = stiffness[:, None, None] * self.held[self._mine]
            matrix.setValuesBlockedRCV(rows, rows, blocks, addv=PETSc.InsertMode.ADD_VALUES)
            matrix.assemble()
        for item in (diagonal, plain, projection, projected):
            item.destroy()

    def projected_columns(self, rows: PETSc.Mat) -> PETSc.Mat:
        """``B P`` for linear forms B (n, k) of displacements; B is given away; collective."""
        if not self._is_anywhere:
            return rows
        projection = self._projection(rows)
        found = rows.matMult(projection)
        for item in (projection, rows):
            item.destroy()
        return found

    def _projection(self, like: PETSc.Mat) -> PETSc.Mat:
        """P, to be multiplied to a matrix from the right; collective."""
        from scipy.sparse import bsr_matrix

        first, last = like.getOwnershipRangeColumn()
        count = (last - first) // self._dim
        blocks = np.tile(np.eye(self._dim), (count, 1, 1))
        blocks[self.nodes[self._mine]] -= self.held[self._mine]
        local = bsr_matrix((blocks, np.arange(count), np.arange(count + 1))).tocsr()
        columns = (local.indices + first).astype(PETSc.IntType)
        csr = local.indptr.astype(PETSc.IntType), columns, local.data
        size = (last - first, None)
        return PETSc.Mat().createAIJ((size, size), csr=csr, comm=like.getComm())

    def _of(self, values: FloatArray) -> tuple[IndexArray, FloatArray]:
        """The nodes that an array of values has, and their projections."""
        inside = self.nodes < len(values) // self._dim
        return self.nodes[inside], self.held[inside]

    @cached_property
    def _is_anywhere(self) -> bool:
        """Whether any rank has such a node; collective."""
        return on_any_rank(self._comm, self._mine)


# The rounding of a unit vector: a direction within this distance of an axis is along the axis.
_ALONG_AXIS = 1e-14
# The sine of the angle between two directions that count as one direction, and between two
# directions that are too close to each other to be held both.
_SAME, _TOO_CLOSE = 1e-6, 1e-2
# A facet belongs to a smooth boundary if its normal is within this cosine of the normal at a node.
_SMOOTH = float(np.cos(np.radians(30.0)))
# Two conditions for one direction agree up to this share of the largest prescribed value.
AGREES = 1e-9


@dataclass(frozen=True)
class PlacedSupport:
    """A support with its local ``nodes`` (k,), ghosts included, and directions m (k, d).

    ``value`` gives the present displacements (k,) along m.
    """

    support: Support
    nodes: IndexArray
    directions: FloatArray
    points: FloatArray
    value: PresentValue

    def rows_at(self, nodes: IndexArray) -> tuple[IndexArray, FloatArray]:
        """The directions at those of the given nodes that the support holds.

        Returns the positions (m,) in ``nodes`` and the directions (m, d).
        """
        places = np.flatnonzero(np.isin(nodes, self.nodes)).astype(np.int32)
        return places, self.directions[np.searchsorted(self.nodes, nodes[places])]


def place(
    domain: Domain, space: fem.FunctionSpace, support: Support, clock: Clock
) -> PlacedSupport:
    """Find the nodes and the directions of a support; collective.

    Raises InputError for a boundary part whose normal jumps at a node.
    """
    facets = domain.facets(support.on, f"{support.key}.on")
    nodes = np.unique(fem.locate_dofs_topological(space, domain.dim - 1, facets))
    nodes = np.asarray(nodes, dtype=np.int32)
    points = space.tabulate_dof_coordinates()[nodes, : domain.dim]
    if support.along == "normal":
        directions = _nodal_normals(domain, space, support, facets)[nodes]
    else:
        unit = np.array(support.along) / np.linalg.norm(support.along)
        directions = np.tile(unit, (len(nodes), 1))
    value = PresentValue(domain.comm, support.value, f"{support.key}.value", clock)
    return PlacedSupport(support, nodes, directions, np.asarray(points.T), value)


def axis_of(domain: Domain, placed: PlacedSupport) -> tuple[int, float] | None:
    """The component and the sign of an axis that all directions of a support have; collective.

    None if a direction is not along the axis.
    """
    for axis in range(domain.dim):
        for sign in (1.0, -1.0):
            wanted = sign * np.eye(domain.dim)[axis]
            away = np.abs(placed.directions - wanted).max(initial=0.0)
            if on_every_rank(domain.comm, bool(away <= _ALONG_AXIS)):
                return axis, sign
    return None


class Supports:
    """The supports of a problem, and the directions that they hold at the nodes.

    ``fixed`` (n,) marks the local dofs of all component conditions.  The constructor is collective
    and raises InputError for directions that are too close to each other.
    """

    def __init__(
        self,
        domain: Domain,
        space: fem.FunctionSpace,
        placed: Sequence[PlacedSupport],
        fixed: BoolArray,
    ) -> None:
        self.placed = tuple(placed)
        self.domain = domain
        dim = domain.dim
        self._points = space.tabulate_dof_coordinates()[:, :dim]
        every = [np.empty(0, dtype=np.int32), *(item.nodes for item in placed)]
        nodes = np.unique(np.concatenate(every))
        # Every row of a node is the direction of one support or of one component condition.
        self._rows = np.zeros((len(nodes), len(placed) + dim, dim))
        for number, item in enumerate(placed):
            self._rows[np.searchsorted(nodes, item.nodes), number] = item.directions
        self._components = fixed.reshape(-1, dim)[nodes]
        axes = np.arange(dim)
        self._rows[:, len(placed) + axes, axes] = self._components
        agree(domain.comm, lambda: self._refuse_close(nodes))
        held, self._inverse = _pseudo_inverse(self._rows)
        owned = space.dofmap.index_map.size_local
        self.directions = HeldDirections(domain.comm, nodes, owned, held)

    def without(self, nodes: IndexArray) -> Supports:
        """The same supports, but not at some local nodes, which other conditions hold wholly."""
        kept = copy.copy(self)
        kept.directions = self.directions.without(nodes)
        return kept

    @property
    def timed(self) -> bool:
        """Whether prescribed values depend on the time."""
        return any(item.support.value.is_timed for item in self.placed)

    def advance(self, u: fem.Function) -> None:
        """Find the prescribed displacements; collective.

        ``u`` has the values of the component conditions, and gets those of the supports.  Raises
        InputError where two conditions prescribe different values for one direction.
        """
        if not self.placed:
            return
        wanted = [item.value(item.points) for item in self.placed]
        nodes, dim = self.directions.nodes, self.domain.dim
        nodal = u.x.array.reshape(-1, dim)
        given = np.zeros(self._rows.shape[:2])
        for number, item in enumerate(self.placed):
            given[np.searchsorted(nodes, item.nodes), number] = wanted[number]
        given[:, len(self.placed) :] = np.where(self._components, nodal[nodes], 0.0)
        self.directions.values = np.einsum("kir,kr->ki", self._inverse, given)
        self.directions.apply(u.x.array)
        comm = self.domain.comm
        largest = max(maximum(comm, np.abs(values)) for values in wanted)
        largest = max(largest, maximum(comm, np.abs(u.x.array)))
        agree(comm, lambda: self._refuse_conflict(u, wanted, AGREES * largest))

    def _refuse_conflict(self, u: fem.Function, wanted: list[FloatArray], most: float) -> None:
        nodal = u.x.array.reshape(-1, self.domain.dim)
        for item, values in zip(self.placed, wanted, strict=True):
            defect = np.abs(np.sum(item.directions * nodal[item.nodes], axis=1) - values)
            if np.any(defect > most):
                where = self.domain.where(self._points[item.nodes[np.argmax(defect)]])
                raise InputError(
                    "another condition prescribes another value for the same direction at "
                    f"{where}; give both conditions the same value there",
                    item.support.key,
                )

    def _refuse_close(self, nodes: IndexArray) -> None:
        """Raise InputError for two directions at a node that are almost the same."""
        for second, item in enumerate(self.placed):
            for first in range(len(self._rows[0]) if len(nodes) else 0):
                if first >= second and first < len(self.placed):
                    continue
                rows, others = self._rows[:, second], self._rows[:, first]
                held = np.any(rows != 0.0, axis=1) & np.any(others != 0.0, axis=1)
                cosine = np.abs(np.sum(rows * others, axis=1))
                sine = np.linalg.norm(
                    rows - np.sum(rows * others, axis=1)[:, None] * others, axis=1
                )
                close = (sine > _SAME) & (sine < _TOO_CLOSE)
                if first < len(self.placed):
                    normals = (self.placed[first].support.along, item.support.along)
                    if normals == ("normal", "normal"):
                        close |= (sine > _SAME) & (cosine > _SMOOTH)
                if np.any(held & close):
                    where = self.domain.where(self._points[nodes[np.argmax(held & close)]])
                    raise InputError(
                        f"at {where} the direction is almost, and not quite, that of another "
                        "condition; let one entry with both names in its on hold both boundary "
                        "parts, or give both conditions the same direction",
                        item.support.key,
                    )


def _pseudo_inverse(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The projections (k, d, d) onto the spans of rows (k, r, d), and the pseudo-inverses.

    The pseudo-inverses (k, d, r) map the prescribed components to the displacement in the span.
    """
    left, sizes, right = np.linalg.svd(rows, full_matrices=False)
    kept = sizes > _SAME
    held = np.einsum("ksi,ks,ksj->kij", right, kept.astype(float), right)
    over = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=kept)
    return held, np.einsum("ksi,ks,krs->kir", right, over, left)


def _nodal_normals(
    domain: Domain, space: fem.FunctionSpace, support: Support, facets: IndexArray
) -> FloatArray:
    """The outward unit normals (k, d) at the local nodes of a support, 0 elsewhere; collective.

    The normal at a vertex is the mean of the normals of the facets of the support around the
    vertex.  A facet with the edges e_i from the vertex has the weight ``1/|e_1|`` in 2D and
    ``sin(angle)/(|e_1| |e_2|)`` in 3D: the mean is then exact for vertices on a circle or a sphere
    (N. Max, 1999, doi:10.1080/10867651.1999.10487501).
    """
    dim, mesh = domain.dim, domain.mesh
    cells = domain.owners(facets)
    # A ghost of a facet counts on the rank that owns the cell.
    own = cells < mesh.topology.index_map(dim).size_local
    facets, cells = facets[own], cells[own]
    nodes, facet = facet_nodes(domain, space, facets, cells), domain.kind.facet
    corners = space.tabulate_dof_coordinates()[nodes[:, : facet.corners], :dim]
    units, weights = _normals_at_corners(corners, facet)
    # At the other nodes of quadratic displacements the facets count alike.
    others = nodes.shape[1] - facet.corners
    weights = np.concatenate([weights, np.ones((len(nodes), others))], axis=1)
    inside = mesh.geometry.x[_compat.cell_corners(mesh)[cells]][..., :dim].mean(axis=1)
    outward = corners.mean(axis=1) - inside
    units = units * np.sign(np.sum(units * outward[:, None], axis=2))[..., None]
    means = units.mean(axis=1, keepdims=True)
    rest = np.repeat(means, nodes.shape[1] - units.shape[1], axis=1)
    units = np.concatenate([units, rest], axis=1)
    sums = summed(space.dofmap.index_map, nodes, weights[..., None] * units)
    sizes = np.linalg.norm(sums, axis=1, keepdims=True)
    normals = np.divide(sums, sizes, out=np.zeros_like(sums), where=sizes > 0.0)
    cosines = np.einsum("fnd,fnd->fn", normals[nodes], units)

    def refuse_edge() -> None:
        if cosines.size and cosines.min() < _SMOOTH:
            facet, place = np.unravel_index(np.argmin(cosines), cosines.shape)
            where = domain.where(space.tabulate_dof_coordinates()[nodes[facet, place], :dim])
            raise InputError(
                f"the boundary has an edge at {where}, where the normal jumps; give each side of "
                "the edge a name and an entry of its own",
                f"{support.key}.along",
            )

    agree(domain.comm, refuse_edge)
    return normals


def _normals_at_corners(corners: FloatArray, kind: CellKind) -> tuple[FloatArray, FloatArray]:
    """Unit normals (f, n, d) at the corners (f, n, d) of facets of a kind, and the weights (f, n).

    The normals are of either sign.
    """
    if kind.dim == 1:
        edges = corners[:, 1] - corners[:, 0]
        sizes = np.linalg.norm(edges, axis=1)[:, None]
        unit = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / sizes
        return np.repeat(unit[:, None], 2, axis=1), np.tile(1.0 / sizes, 2)
    # The corners of the simplex beside each corner.
    beside = kind.beside * kind.corners if kind.is_simplex else kind.beside
    around = [(i, *(j for j in ends if j != i)) for i, ends in enumerate(beside)]
    at, one, other = (corners[:, list(places)] for places in zip(*around, strict=True))
    first, second = one - at, other - at
    normals = np.cross(first, second)
    sizes = np.linalg.norm(normals, axis=2)
    squares = np.sum(first**2, axis=2) * np.sum(second**2, axis=2)
    return normals / sizes[..., None], sizes / squares
