"""Whether the mesh of a file can be a body: cells, neighbours, boundary and groups.

One process has the whole mesh.  A mesh that cannot be a body raises an InputError, with the numbers
of nodes and cells in the file and their coordinates.  A suspicious mesh causes a warning.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.findings import Finding
from contact_locking.mesh.data import (
    MeshData,
    MeshElements,
    and_more,
    components,
    keys,
    listed,
    longest_edges,
    point_words,
    signed_measures,
)

# A cell has collapsed, or nearly collapsed, if its least Jacobian at a corner, |cell| d! for a
# simplex, over (longest distance of corners)^d is below these shares.
_COLLAPSED = 1e-12
_NEARLY_COLLAPSED = 1e-6
# A mesh of more parts is one whose elements share no nodes: nobody holds so many parts one by one.
_MOST_PARTS = 100
# Nodes are at one place if they are nearer than this share of a facet: files hold rounded numbers.
_SAME_PLACE = 1e-5
_FRAGMENT = (
    "make one mesh of what meets there (fragment in Gmsh before it is meshed, or "
    "gmsh.model.mesh.removeDuplicateNodes)"
)

#: Pairs of boundary parts, each by its names, that may touch each other without shared nodes.
Touching = tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]


def checked(mesh: MeshData, touching: Touching = ()) -> MeshData:
    """The mesh, whose groups of facets are those that bound the body, with findings.

    Raises InputError if the mesh cannot be a body: for coordinates that are not finite, cells that
    occur twice, have collapsed, are folded, overlap or have no region, facets of three cells, parts
    that touch without shared nodes except ``touching`` ones, and nodes that hang on facets.
    """
    _check_arrays(mesh)
    findings = [*mesh.findings, *check_cells(mesh)]
    facets = CellFacets(mesh)
    facets.check_neighbours()
    bare = mesh.cells.groups == 0
    if bare.any():
        raise InputError(
            "it has cells outside every group (in Gmsh every physical group), such as "
            f"{mesh.cell_words(int(np.argmax(bare)))}{and_more(int(bare.sum()))}; name them all"
        )
    findings += _check_boundary(facets, touching)
    groups, unusable, about_groups = _on_boundary(facets)
    return replace(mesh, facets=groups, unusable=unusable, findings=(*findings, *about_groups))


def _check_arrays(mesh: MeshData) -> None:
    """Raise InputError for what DOLFINx cannot take: no numbers, a node or a cell twice."""
    kind, cells = mesh.kind, mesh.cells
    bad = ~np.isfinite(mesh.points).all(axis=1)
    if bad.any():
        raise InputError(
            f"the coordinates of {mesh.node_words(int(np.argmax(bad)))} are not finite numbers"
            f"{and_more(int(bad.sum()))}"
        )
    corners = np.sort(cells.nodes, axis=1)
    twice = (corners[:, 1:] == corners[:, :-1]).any(axis=1)
    if twice.any():
        raise InputError(
            f"{mesh.cell_words(int(np.argmax(twice)))} has the same node twice"
            f"{and_more(int(twice.sum()))}"
        )
    _, first, number, count = np.unique(
        keys(corners, len(mesh.points)), return_index=True, return_inverse=True, return_counts=True
    )
    if (count > 1).any():
        cell = first[np.argmax(count > 1)]
        copy = np.flatnonzero(number == number[cell])[1]
        raise InputError(
            f"{kind.name} {cells.numbers[copy]} is {kind.name} {cells.numbers[cell]} once more, at "
            f"{point_words(mesh.points[corners[cell]].mean(axis=0))}: they have the same nodes"
            f"{and_more(int(np.sum(count > 1)))}; remove the duplicates (in Gmsh "
            "gmsh.model.mesh.removeDuplicateElements)"
        )


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
    cell = mesh.cell_words(int(np.argmax(thin)))
    return [Finding("mesh.thin_cells", cell=cell, count=int(thin.sum()), kind=kind.name)]


class CellFacets:
    """The different facets of the cells of a mesh.

    ``of_cells`` (k, m) are the facets of each cell in the order of `CellKind`, and ``count`` (f,)
    is the number of cells of each facet.
    """

    def __init__(self, mesh: MeshData) -> None:
        self.mesh = mesh
        self._keys, number, self.count = np.unique(
            self._keys_of(mesh.kind.facets_of(mesh.cells.nodes)),
            return_inverse=True,
            return_counts=True,
        )
        self.of_cells: IntArray = number.reshape(len(mesh.kind.facets), -1).T

    def _keys_of(self, nodes: IntArray) -> IntArray:
        return keys(np.sort(nodes, axis=1), len(self.mesh.points))

    def find(self, nodes: IntArray) -> IntArray:
        """The facets (k,) with the nodes (k, n), -1 for those of no cell."""
        values = self._keys_of(nodes)
        place = np.minimum(np.searchsorted(self._keys, values), len(self._keys) - 1)
        return np.where(self._keys[place] == values, place, -1)

    def with_cells(self, marks: BoolArray) -> tuple[IntArray, IntArray]:
        """The cells (k,) of marked facets, and the nodes (k, n) of the facets, for each cell."""
        cells, sides = np.nonzero(marks[self.of_cells])
        corners = np.array(self.mesh.kind.facets)[sides]
        return cells, self.mesh.cells.nodes[cells[:, None], corners]

    @property
    def parts(self) -> tuple[int, IntArray]:
        """The number of parts whose cells are joined by facets, and the part (k,) of each cell."""
        facets = self.of_cells.reshape(-1)
        order = np.argsort(facets, kind="stable")
        pairs = order[self.count[facets[order]] == 2].reshape(-1, 2) // self.of_cells.shape[1]
        return components(pairs, len(self.of_cells))

    def check_neighbours(self) -> None:
        """Raise InputError for a facet of three cells, or of two cells on one side of it."""
        mesh, kind = self.mesh, self.mesh.kind
        if (self.count > 2).any():
            cells, nodes = self.with_cells(np.arange(len(self.count)) == np.argmax(self.count > 2))
            middle = point_words(mesh.points[nodes[0]].mean(axis=0))
            raise InputError(
                f"{len(cells)} {kind.plural} share one {'edge' if kind.dim == 2 else 'face'} "
                f"({mesh.nodes_words(nodes[0])} at {middle}): {listed(mesh.cells.numbers[cells])}"
                f"{and_more(int(np.sum(self.count > 2)))}; "
                "at most two can, as cells do not overlap"
            )
        # The sum of the sides, 1 or -1, on which the cells lie of a facet whose nodes ascend.
        sums = np.bincount(self.of_cells.reshape(-1), self._sides().reshape(-1))
        folded = (self.count == 2) & (sums != 0.0)
        if folded.any():
            cells, nodes = self.with_cells(folded)
            of_first = self.find(nodes) == self.find(nodes[:1])
            neighbour = mesh.cells.numbers[cells[of_first][1]]
            raise InputError(
                f"{mesh.cell_words(int(cells[0]))} and its neighbour {neighbour} overlap: they lie "
                f"on one side of what they share ({mesh.nodes_words(nodes[0])})"
                f"{and_more(int(folded.sum()))}; one of them is turned over"
            )

    def _sides(self) -> FloatArray:
        """(k, m) the side of each facet of each cell on which the cell lies, 1 or -1."""
        mesh, sides = self.mesh, np.empty(self.of_cells.shape)
        for number, (facet, off) in enumerate(
            zip(mesh.kind.facets, mesh.kind.opposite, strict=True)
        ):
            corners = np.sort(mesh.cells.nodes[:, list(facet)], axis=1)[:, : mesh.dim]
            simplices = np.column_stack([corners, mesh.cells.nodes[:, off]])
            sides[:, number] = np.sign(signed_measures(mesh.points, simplices))
        return sides


def _check_boundary(facets: CellFacets, touching: Touching) -> list[Finding]:
    """The finding of cracks.

    Raises InputError where parts touch without shared nodes, a node hangs on a facet, or there are
    too many parts.
    """
    mesh, kind = facets.mesh, facets.mesh.kind.facet
    count, part_of_cell = facets.parts
    cells, corners = facets.with_cells(facets.count == 1)
    boundary = kind.split(corners)
    owner = np.repeat(cells, len(kind.simplices))
    parts = np.empty(len(mesh.points), dtype=np.int64)
    parts[boundary] = part_of_cell[owner][:, None]
    node, facet, shares = _meetings(mesh, boundary)
    apart = ~_may_meet(mesh, touching, node, boundary[facet], shares > _SAME_PLACE)
    node, facet, shares = node[apart], facet[apart], shares[apart]
    is_double = shares.max(axis=1, initial=0.0) > 1.0 - 10 * _SAME_PLACE
    partner = boundary[facet, np.argmax(shares, axis=1)]
    doubles = np.unique(np.sort(np.stack([node, partner], axis=1)[is_double], axis=1), axis=0)
    of_two = doubles[parts[doubles[:, 0]] != parts[doubles[:, 1]]]
    if len(of_two):
        raise InputError(
            f"two parts of the body touch and share no nodes: {_pairs_words(mesh, of_two)}; "
            f"{_FRAGMENT}, or leave a gap"
        )
    hanging = np.flatnonzero(~is_double)
    if len(hanging):
        first = int(hanging[np.argmin(mesh.numbers[node[hanging]])])
        article, what = ("an", "edge") if mesh.dim == 2 else ("a", "face")
        number = mesh.cells.numbers[owner[facet[first]]]
        raise InputError(
            f"{mesh.node_words(int(node[first]))} hangs: it lies on {article} {what} of "
            f"{mesh.kind.name} {number} ({mesh.nodes_words(boundary[facet[first]])}), and is "
            f"none of its corners{and_more(len(np.unique(node[hanging])))}, so that the body would "
            f"be cut there; neighbours have to share whole {what}s: {_FRAGMENT}"
        )
    if count > _MOST_PARTS:
        raise InputError(
            f"the body falls into {count} parts that share no edges or faces; at most "
            f"{_MOST_PARTS} are allowed"
        )
    if not len(doubles):
        return []
    return [Finding("mesh.cut", nodes=_pairs_words(mesh, doubles), advice=_FRAGMENT)]


def _pairs_words(mesh: MeshData, pairs: IntArray) -> str:
    """The first of pairs (k, 2) of nodes at one place, and the number of the other nodes."""
    first, other = pairs[0]
    others = len(np.unique(pairs)) - 2
    return (
        f"nodes {mesh.numbers[first]} and {mesh.numbers[other]} are both at "
        f"{point_words(mesh.points[first])}{f', and {others} more nodes' if others else ''}"
    )


def _meetings(mesh: MeshData, boundary: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Nodes (k,) that lie on simplices (k,) of the boundary (f, d), and are none of its corners.

    Returns also the barycentric coordinates (k, d).
    """
    from scipy.spatial import cKDTree

    nodes = np.unique(boundary)
    tree = cKDTree(mesh.points[nodes])
    corners, size = mesh.points[boundary], longest_edges(mesh.points, boundary)
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1) * (1.0 + _SAME_PLACE)
    # The ball around a facet holds the corners of the facet, and seldom many other nodes.
    crowded = np.flatnonzero(tree.query_ball_point(middle, reach, return_length=True) > mesh.dim)
    lists = (
        [
            np.array(near, dtype=np.int64)
            for near in tree.query_ball_point(middle[crowded], reach[crowded])
        ]
        if len(crowded)
        else []
    )
    facet = np.repeat(crowded, [len(near) for near in lists])
    node = nodes[np.concatenate([np.empty(0, dtype=np.int64), *lists])]
    keep = (node[:, None] != boundary[facet]).all(axis=1)
    facet, node = facet[keep], node[keep]
    # In units of the size of the facet, so that no product underflows.
    size, corners = size[facet], corners[facet]
    edges = (corners[:, :-1] - corners[:, -1:]) / size[:, None, None]
    away = (mesh.points[node] - corners[:, -1]) / size[:, None]
    gram = np.einsum("kia,kja->kij", edges, edges)
    right = np.einsum("kia,ka->ki", edges, away)
    inside = np.linalg.solve(gram, right[:, :, None])[:, :, 0]
    shares = np.column_stack([inside, 1.0 - inside.sum(axis=1)])
    off = np.linalg.norm(away - np.einsum("ki,kia->ka", inside, edges), axis=1)
    on = (off <= _SAME_PLACE) & (shares >= -_SAME_PLACE).all(axis=1)
    return node[on], facet[on], shares[on]


def _may_meet(
    mesh: MeshData, touching: Touching, node: IntArray, others: IntArray, beside: BoolArray
) -> BoolArray:
    """(k,) whether nodes (k,) and those ``beside`` (k, n) of ``others`` are on touching sides.

    At the rim of a side nodes are on an edge of a facet beside the other one.
    """
    may = np.zeros(len(node), dtype=bool)
    for pair in touching:
        sides = []
        for names in pair:
            rows = np.any([mesh.facets.named(name) for name in names], axis=0)
            on_side = np.zeros(len(mesh.points), dtype=bool)
            on_side[mesh.facets.nodes[rows]] = True
            sides.append(on_side)
        for a, b in (sides, sides[::-1]):
            may |= a[node] & (b[others] | ~beside).all(axis=1)
    return may


def _on_boundary(facets: CellFacets) -> tuple[MeshElements, dict[str, str], list[Finding]]:
    """The groups of facets with those on the boundary of the body, and findings.

    For the name of every other group there is the reason why it bounds nothing.
    """
    mesh, kind = facets.mesh, facets.mesh.kind
    unusable, findings = dict[str, str](), list[Finding]()
    kept = np.zeros(len(mesh.facets), dtype=bool)
    number = facets.find(mesh.facets.nodes)
    is_outside = (number >= 0) & (facets.count[number] == 1)
    for name in mesh.facets.names:
        in_group = mesh.facets.named(name)
        kept |= in_group & is_outside
        others = np.flatnonzero(in_group & ~is_outside)
        if len(others):
            first = int(others[0])
            where = "has cells on both sides" if number[first] >= 0 else "is no facet of a cell"
            text = (
                f"group {name!r}: {len(others)} of its {in_group.sum()} {kind.facet_word}s are not "
                f"on the boundary of the body, such as {mesh.facet_words(first)} "
                f"({mesh.nodes_words(mesh.facets.nodes[first])}), which {where}"
            )
            if len(others) == in_group.sum():
                unusable[name] = text
            # A group inside the body alone is often an interface.
            if len(others) < in_group.sum() or (number[others] < 0).any():
                findings.append(Finding("mesh.group_off_boundary", text=text, count=len(others)))
    names = {name: tags for name, tags in mesh.facets.names.items() if name not in unusable}
    return replace(mesh.facets.take(kept), names=names), unusable, findings
