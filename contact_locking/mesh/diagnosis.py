"""The one check of a mesh of the user, distributed, of which no rank needs to have the whole.

1. Each rank checks the shapes of its own cells.
2. For each facet the sides on which the cells of all ranks lie are added up: the sum is 0 where two
   cells lie on different sides.
3. The connected parts of the cells of each rank are joined where a facet has cells of two ranks.
4. The boundary, which is small beside the body, is checked on one rank.

A mesh that cannot be a body raises an InputError, with the numbers of nodes and cells in the file
and their coordinates.  A suspicious mesh causes a warning.  `file.diagnosis` checks before what
DOLFINx needs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import FloatArray, IndexArray, IntArray
from contact_locking.errors import InputError
from contact_locking.findings import Finding
from contact_locking.mesh.array_checks import check_boundary
from contact_locking.mesh.cell_kind import NAMED, components, longest_edges, signed_measures
from contact_locking.mesh.data import MeshData, MeshElements, and_more, point_words
from contact_locking.mesh.distribution import EntityGroup, FileNumbers, marked, summed
from contact_locking.parallel import agree, on_root

# A cell has collapsed, or nearly collapsed, if its least Jacobian at a corner, |cell| d! for a
# simplex, over (longest distance of corners)^d is below these shares.
_COLLAPSED = 1e-12
_NEARLY_COLLAPSED = 1e-6
# A mesh of more parts is one whose elements share no nodes: nobody holds so many parts one by one.
_MOST_PARTS = 100

#: Pairs of boundary parts, each by its names, that may touch each other without shared nodes.
Touching = tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]


class DistributedCells:
    """The owned cells (k, c) of a mesh, with sums over the cells of all ranks at facets.

    ``data`` has the points and the owned cells of this rank, with their numbers in the file, which
    are counted from 0 without ``numbers``.  ``facets`` (k, n) are the local facets of the cells in
    the order of `CellKind`.  ``shared`` (f,) is the number of cells of each local facet, and
    ``sides`` (f,) the sum of the sides, 1 or -1, on which these cells lie.  The constructor is
    collective.
    """

    def __init__(self, mesh: dmesh.Mesh, numbers: FileNumbers | None = None) -> None:
        topology, dim = mesh.topology, int(mesh.topology.dim)
        self._mesh, self.comm = mesh, mesh.comm
        topology.create_connectivity(dim - 1, dim)
        topology.create_connectivity(dim, dim - 1)
        self._map = topology.index_map(dim - 1)
        self.owned_facets = self._map.size_local
        owned = topology.index_map(dim).size_local
        self._kind = NAMED[topology.cell_name()]
        facets = topology.connectivity(dim, dim - 1).array
        self.facets = facets.reshape(-1, len(self._kind.facets))[:owned]
        if numbers is None:
            numbers = FileNumbers(
                np.asarray(mesh.geometry.input_global_indices, dtype=np.int64),
                np.asarray(topology.original_cell_index, dtype=np.int64),
            )
        corners = np.asarray(_compat.cell_corners(mesh)[:owned], dtype=np.int64)
        points = np.array(mesh.geometry.x[:, :dim])
        cells = MeshElements.unnamed(corners, numbers.cells[:owned])
        self.data = MeshData(dim, points, numbers.nodes, cells)
        both = np.stack([np.ones_like(self.facets, dtype=float), self._signs()], axis=2)
        sums = summed(self._map, self.facets, both)
        self.shared: IntArray = np.rint(sums[:, 0]).astype(np.int64)
        self.sides: IntArray = np.rint(sums[:, 1]).astype(np.int64)

    def corners(self, cells: IntArray, sides: IntArray) -> IntArray:
        """The nodes (m, n) of the facets number ``sides`` (m,) of cells (m,)."""
        return self.data.cells.nodes[cells[:, None], np.array(self._kind.facets)[sides]]

    def first_facet(self, facets: IndexArray) -> str:
        """The first of local facets by its centre and its nodes; empty without any."""
        if not len(facets):
            return ""
        nodes = _compat.entities_to_geometry(self._mesh, self.data.dim - 1, facets[:1])[0]
        centre = self.data.points[nodes].mean(axis=0)
        return f"at {point_words(centre)} ({self.data.nodes_words(nodes)})"

    @cached_property
    def parts(self) -> tuple[IndexArray, int]:
        """The connected part (k,) of each local cell, ghosts included, and their number.

        Collective.
        """
        return connected_parts(self._mesh)

    def check(
        self, groups: Mapping[str, IndexArray] | None = None, touching: Touching = ()
    ) -> list[Finding]:
        """Findings about the mesh; collective.

        ``groups`` are local facets by name.  Raises InputError, on all ranks, if the mesh cannot be
        a body.
        """
        # Of a small mesh a rank may have no cells.
        local = agree(self.comm, lambda: check_cells(self.data) if len(self.facets) else [])
        # Of the cells of all ranks with the same finding the first rank names one.
        findings: list[Finding] = next(filter(None, self.comm.allgather(local)), [])
        agree(self.comm, self._check_folds)
        findings += self._check_boundary(groups or {}, touching)
        _, count = self.parts
        if count > _MOST_PARTS:
            raise InputError(
                f"the body falls into {count} parts that share no edges or faces; at most "
                f"{_MOST_PARTS} are allowed"
            )
        return findings

    def _check_folds(self) -> None:
        folded = (self.shared[self.facets] == 2) & (self.sides[self.facets] != 0)
        if folded.any():
            cells, sides = np.nonzero(folded)
            facet = self.facets[cells[0], sides[0]]
            beside = cells[self.facets[folded] == facet][1:]
            # The neighbour may be on another rank.
            neighbour = "".join(f" {number}" for number in self.data.cells.numbers[beside])
            corners = self.corners(cells[:1], sides[:1])[0]
            raise InputError(
                f"{self.data.cell_words(int(cells[0]))} and its neighbour{neighbour} overlap: "
                f"they lie on one side of what they share ({self.data.nodes_words(corners)})"
                f"{and_more(len(np.unique(self.facets[folded])))}; one of them is turned over"
            )

    def _check_boundary(
        self, groups: Mapping[str, IndexArray], touching: Touching
    ) -> list[Finding]:
        """Check that neighbours share nodes, with the boundary of the body on rank 0; collective.

        Raises InputError where parts touch without shared nodes, or a node hangs on a facet.
        """
        cells, sides = np.nonzero(self.shared[self.facets] == 1)
        corners = self.corners(cells, sides)
        pairs = [side for pair in touching for side in pair]
        of_side = np.zeros((len(cells), len(pairs)), dtype=bool)
        for column, names in enumerate(pairs):
            of_names = [groups[name] for name in names if name in groups]
            facets = np.concatenate([np.empty(0, dtype=np.int32), *of_names])
            of_side[:, column] = marked(self._map, facets)[self.facets[cells, sides]]
        local = (
            self.data.cells.numbers[cells],
            sides,
            self.data.numbers[corners],
            self.data.points[corners],
            self.parts[0][cells],
            of_side,
        )
        gathered = [self.comm.gather(np.ascontiguousarray(values)) for values in local]

        def judge() -> list[Finding]:
            whole = [np.concatenate(values) for values in gathered if values is not None]
            order = np.lexsort((whole[1], whole[0]))
            owners, _, numbers, points, parts, marks = (values[order] for values in whole)
            nodes, first, inverse = np.unique(numbers, return_index=True, return_inverse=True)
            nowhere = np.zeros((len(owners), self._kind.corners), dtype=np.int64)
            boundary = MeshData(
                self.data.dim,
                points.reshape(-1, self.data.dim)[first],
                nodes,
                MeshElements.unnamed(nowhere, owners),
            )
            facets = inverse.reshape(-1, self._kind.facet.corners)
            on_side = np.zeros((len(pairs), len(nodes)), dtype=bool)
            for side, of_facets in zip(on_side, marks.T, strict=True):
                side[facets[of_facets]] = True
            facing = [*zip(on_side[::2], on_side[1::2], strict=True)]
            return check_boundary(boundary, facets, np.arange(len(owners)), parts, facing)

        return on_root(self.comm, judge)

    def _signs(self) -> FloatArray:
        """(k, n) the side of each facet of each cell on which the cell lies, 1 or -1.

        The nodes of the facet, in the order of their numbers in the file, orient the facet.
        """
        signs = np.empty(self.facets.shape)
        cells = np.arange(len(signs))
        for side, off in enumerate(self._kind.opposite):
            corners = self.corners(cells, np.full(len(cells), side))
            order = np.argsort(self.data.numbers[corners], axis=1)
            ordered = np.take_along_axis(corners, order, axis=1)[:, : self.data.dim]
            simplices = np.column_stack([ordered, self.data.cells.nodes[:, off]])
            signs[:, side] = np.sign(signed_measures(self.data.points, simplices))
        return signs


def check_cells(mesh: MeshData) -> list[Finding]:
    """The finding of thin cells.  Raises InputError for a cell that has collapsed or is folded."""
    cells, kind = mesh.cells.nodes, mesh.kind
    length = longest_edges(mesh.points, cells)
    # A collapsed cell may have a volume from the rounding of its coordinates.
    rounding = 8 * np.finfo(float).eps * np.abs(mesh.points).max() / np.maximum(length, 1e-300)
    beside = cells[:, np.array(kind.beside)].reshape(-1, mesh.dim + 1)
    with np.errstate(all="ignore"):
        jacobians = signed_measures(mesh.points, beside).reshape(len(cells), -1)
        share = np.abs(jacobians).min(axis=1) / length**mesh.dim
    # The comparison is also false for NaN, from an underflow of lengths or an overflow of volumes.
    bad = ~(share > np.maximum(_COLLAPSED, rounding))
    if bad.any():
        raise InputError(
            f"{mesh.cell_words(int(np.argmax(bad)))} has collapsed: its nodes lie on one "
            f"{'line' if mesh.dim == 2 else 'plane'}{and_more(int(bad.sum()))}"
        )
    turned = np.sign(jacobians).min(axis=1) != np.sign(jacobians).max(axis=1)
    if turned.any():
        raise InputError(
            f"{mesh.cell_words(int(np.argmax(turned)))} is folded{and_more(int(turned.sum()))}"
            f"; the corners of a {kind.name} must be convex and in Gmsh's order"
        )
    thin = share < _NEARLY_COLLAPSED
    if not thin.any():
        return []
    cell, count = mesh.cell_words(int(np.argmax(thin))), int(thin.sum())
    more = and_more(count)
    return [Finding("mesh.thin_cells", cell=cell, count=count, more=more, kind=kind.name)]


def connected_parts(mesh: dmesh.Mesh) -> tuple[IndexArray, int]:
    """The connected part (k,) of each local cell, and how many parts there are; collective.

    Cells of one part are joined by facets.  The parts are numbered by the cells that come first in
    the mesh that was given.
    """
    topology, comm, dim = mesh.topology, mesh.comm, mesh.topology.dim
    cells, facets = topology.index_map(dim), topology.index_map(dim - 1)
    joint = topology.connectivity(dim - 1, dim)
    counts = np.diff(joint.offsets)
    pairs = joint.array[np.repeat(counts == 2, counts)].reshape(-1, 2)
    local_count, local = components(pairs, cells.size_local + cells.num_ghosts)
    every = comm.allgather(local_count)
    local = local + sum(every[: comm.rank])

    def part_of(some: IntArray) -> IntArray:
        return local[joint.array[joint.offsets[some]]]

    # A facet that two ranks have joins their parts: one of them knows it as a ghost.
    ghosts = np.arange(facets.size_local, facets.size_local + facets.num_ghosts)
    theirs = np.column_stack([facets.ghosts, part_of(ghosts)])
    shared = np.concatenate(comm.allgather(theirs))
    rows = shared[:, 0] - facets.local_range[0]
    is_own = (rows >= 0) & (rows < facets.size_local)
    edges = np.column_stack([part_of(rows[is_own]), shared[is_own, 1]])
    count, whole = components(np.concatenate(comm.allgather(edges)), sum(every))
    numbers = whole[local]
    first = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(first, numbers, np.asarray(topology.original_cell_index, dtype=np.int64))
    first = np.min(comm.allgather(first), axis=0)
    return np.argsort(np.argsort(first))[numbers].astype(np.int32), count


def part_names(
    mesh: dmesh.Mesh, parts: IndexArray, count: int, regions: IndexArray, names: Mapping[str, int]
) -> tuple[str, ...]:
    """The name of each part, from its regions and its extreme coordinates; collective.

    ``parts`` (k,) and ``regions`` (k,) are the numbers of the local cells, and ``names`` gives the
    numbers of regions.
    """
    if count == 1:
        return ("the body",)
    words_of_all = []
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    corners = _compat.cell_corners(mesh)[:owned]
    for body in range(count):
        inside = parts[:owned] == body
        mine = set(np.unique(regions[:owned][inside]).tolist())
        every = set().union(*mesh.comm.allgather(mine))
        of_part = [name for name, number in names.items() if number in every]
        x = mesh.geometry.x[corners[inside], : mesh.topology.dim].reshape(-1, mesh.topology.dim)
        low, high = (point_words(corner) for corner in box(mesh.comm, x))
        words = ", ".join([*of_part, f"from {low} to {high}"])
        words_of_all.append(f"part {body + 1} of the body ({words})")
    return tuple(words_of_all)


def box(comm: MPI.Intracomm, points: FloatArray) -> FloatArray:
    """The least and the greatest coordinates (2, d) of the points of all ranks; collective."""
    low = comm.allgather(points.min(axis=0, initial=np.inf))
    high = comm.allgather(points.max(axis=0, initial=-np.inf))
    return np.array([np.min(low, axis=0), np.max(high, axis=0)])


def on_boundary(
    groups: Sequence[EntityGroup], cells: DistributedCells
) -> tuple[list[EntityGroup], dict[str, str], list[Finding]]:
    """The groups with their facets on the boundary, and findings; collective.

    For the name of every other group there is the reason why it bounds nothing.
    """
    kept: list[EntityGroup] = []
    unusable: dict[str, str] = {}
    findings: list[Finding] = []
    comm, kind = cells.comm, cells.data.kind
    what, lines = "edge" if kind.dim == 2 else "face", f"{kind.facet_word}s"
    for group in groups:
        name, inner = group.name, cells.shared[group.entities] == 2
        owned = group.entities < cells.owned_facets
        total_owned, inside = (
            comm.allreduce(int(np.count_nonzero(marks))) for marks in (owned, owned & inner)
        )
        total = total_owned + group.missing
        if group.missing:
            example = f", such as {group.example}" if group.example else ""
            unusable[name] = (
                f"{name!r} does not lie on the body: {group.missing} of its {total} {lines} are no "
                f"{what}s of the body's {kind.plural}{example}; remove what dangles, or make it "
                "part of the body's mesh (fragment)"
            )
            numbers = {"missing": group.missing, "total": total}
            off = Finding("mesh.group_off_body", reason=unusable[name], group=name, **numbers)
            findings.append(off)
        elif inside == total:
            unusable[name] = (
                f"{name!r} lies inside the body and is not a part of its boundary: its {lines} "
                "have cells on both sides"
            )
        else:
            if inside:
                dangling = group.entities[inner & owned]
                example = next(filter(None, comm.allgather(cells.first_facet(dangling))))
                words = {"group": name, "facets": lines, "example": f"{what} {example}"}
                findings.append(Finding("mesh.group_inside", inside=inside, total=total, **words))
            kept.append(EntityGroup(name, group.entities[~inner]))
    require_different([group.name for group in kept], f"{what}s")
    return kept, unusable, findings


def require_different(names: Sequence[str], kind: str) -> None:
    """Raise InputError for a name that two groups of the kind have."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"it has two groups of {kind} named {name!r}")
