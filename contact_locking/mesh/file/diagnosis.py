"""The check of a mesh file before any computation.

A mesh that cannot be a body raises an InputError, with the numbers of nodes and elements in the
file and their coordinates.  A suspicious mesh causes a warning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.file import places
from contact_locking.mesh.file.contiguity import Touching, check_contiguity
from contact_locking.mesh.file.data import MeshData, MeshElements
from contact_locking.mesh.file.topology import Facets, components, longest_edges, signed_measures
from contact_locking.mesh.lagrange import curved_jacobians

# A cell has collapsed, or nearly collapsed, if its least Jacobian at a corner, |cell| d! for a
# simplex, over (longest distance of corners)^d is below these shares.
_COLLAPSED = 1e-12
_NEARLY_COLLAPSED = 1e-6
#: A mesh of more parts is one whose elements share no nodes: nobody holds so many parts one by one.
MOST_PARTS = 100


@dataclass(frozen=True)
class Diagnosis:
    """The result for a mesh that can be a body.

    ``parts`` (k,) gives for each cell the index of its connected part in ``part_names``; facets
    connect the cells of a part.  ``facets`` are the named facets on the boundary.  ``unusable``
    gives, for the name of every other group of facets, why the group bounds nothing.
    """

    part_names: tuple[str, ...]
    parts: IntArray
    facets: MeshElements
    unusable: dict[str, str]
    warnings: list[str]

    @staticmethod
    def of_sound(mesh: MeshData, bodies: int = 1) -> Diagnosis:
        """The result for a mesh of a builder, with all groups of facets on the boundary.

        ``bodies`` is the number of its parts that share no nodes.
        """
        named = mesh.facets.take(mesh.facets.groups != 0)
        labels: IntArray = np.zeros(len(mesh.cells), dtype=np.int64)
        if bodies > 1:
            facets = Facets(mesh.cells.nodes, len(mesh.points), mesh.kind)
            joined, _ = facets.pairs(np.flatnonzero(facets.shared == 2))
            bodies, labels = components(joined, len(mesh.cells))
        return Diagnosis(_part_names(mesh, bodies, labels), labels, named, {}, [])


def diagnose(mesh: MeshData, origin: str, touching: Touching = ()) -> Diagnosis:
    """Check a mesh, which messages call ``origin``; raises InputError if it cannot be a body.

    ``touching`` are pairs of boundary parts that may touch each other without shared nodes.
    """
    try:
        return _diagnose(mesh, touching)
    except InputError as error:
        raise InputError(f"{origin}: {error}", error.key) from None


def _diagnose(mesh: MeshData, touching: Touching) -> Diagnosis:
    warnings = _told_of_order(mesh)
    check_coordinates(mesh)
    _check_groups_of_cells(mesh)
    check_cells(mesh, warnings)
    check_curved(mesh)
    facets = Facets(mesh.cells.nodes, len(mesh.points), mesh.kind)
    _check_sharing(mesh, facets)
    _check_folds(mesh, facets)
    joined, _ = facets.pairs(np.flatnonzero(facets.shared >= 2))
    count, labels = components(joined, len(mesh.cells))
    check_contiguity(mesh, facets, labels, warnings, touching)
    if count > MOST_PARTS:
        raise InputError(
            f"the body falls into {count} parts that share no edges or faces; at most "
            f"{MOST_PARTS} are allowed"
        )
    named, unusable = _named_facets(mesh, facets, warnings)
    return Diagnosis(_part_names(mesh, count, labels), labels, named, unusable, warnings)


def _told_of_order(mesh: MeshData) -> list[str]:
    if mesh.straightened is None or mesh.curved is not None:
        return []
    what = "area" if mesh.dim == 2 else "volume"
    return [
        "its cells are of second order; their corners alone are taken, so that sides are straight: "
        f"the {what} changes by {mesh.straightened:.1%}. discretisation.degree: 2 takes the curved "
        "sides of triangles, quadrilaterals and tetrahedra, and needs no nodes on straight edges"
    ]


def _part_names(mesh: MeshData, count: int, labels: IntArray) -> tuple[str, ...]:
    """The name of each part, from its regions and its least and greatest coordinates."""
    if count == 1:
        return ("the body",)
    names = []
    for part in range(count):
        own = labels == part
        regions = ", ".join(mesh.cells.name(int(g)) for g in np.unique(mesh.cells.groups[own]))
        x = mesh.points[mesh.cells.nodes[own]].reshape(-1, mesh.dim)
        low, high = places.at(x.min(axis=0)), places.at(x.max(axis=0))
        names.append(f"part {part + 1} of the body ({regions}, from {low} to {high})")
    return tuple(names)


def check_coordinates(mesh: MeshData) -> None:
    """Raise InputError for a coordinate that is no finite number."""
    bad = ~np.isfinite(mesh.points).all(axis=1)
    if bad.any():
        raise InputError(
            f"the coordinates of {places.node(mesh, int(np.argmax(bad)))} are not finite numbers"
            f"{places.more(int(bad.sum()))}"
        )


def _check_groups_of_cells(mesh: MeshData) -> None:
    bare = mesh.cells.groups == 0
    if bare.any():
        raise InputError(
            f"it has cells outside every physical group, such as "
            f"{places.cell(mesh, int(np.argmax(bare)))}{places.more(int(bare.sum()))}; name them "
            "all"
        )


def check_cells(mesh: MeshData, warnings: list[str]) -> None:
    """Raise InputError for a cell that has collapsed or has a node twice."""
    cells = mesh.cells.nodes
    kind = mesh.kind
    corners = np.sort(cells, axis=1)
    twice = (corners[:, 1:] == corners[:, :-1]).any(axis=1)
    if twice.any():
        raise InputError(
            f"{places.cell(mesh, int(np.argmax(twice)))} has the same node twice"
            f"{places.more(int(twice.sum()))}"
        )
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
            f"{places.cell(mesh, int(np.argmax(bad)))} has collapsed: its nodes lie on one "
            f"{'line' if mesh.dim == 2 else 'plane'}{places.more(int(bad.sum()))}"
        )
    turned = np.sign(jacobians).min(axis=1) != np.sign(jacobians).max(axis=1)
    if turned.any():
        raise InputError(
            f"{places.cell(mesh, int(np.argmax(turned)))} is folded{places.more(int(turned.sum()))}"
            f"; the corners of a {kind.name} must be convex and in Gmsh's order"
        )
    thin = share < _NEARLY_COLLAPSED
    if thin.any():
        warnings.append(
            f"{places.cell(mesh, int(np.argmax(thin)))} has nearly collapsed"
            f"{places.more(int(thin.sum()))}; digits are lost where a {kind.name} is so thin"
        )


def check_curved(mesh: MeshData) -> None:
    """Raise InputError for a curved cell that is folded, and for edges that come apart."""
    if mesh.curved is None:
        return
    first, edges = mesh.kind.corners, mesh.kind.edges
    ends = np.sort(mesh.curved[:, edges], axis=2).reshape(-1, 2)
    middles = mesh.curved[:, first : first + len(edges)].reshape(-1)
    of_edge = np.unique(np.column_stack([ends, middles]), axis=0)
    twice = (of_edge[1:, :2] == of_edge[:-1, :2]).all(axis=1)
    if twice.any():
        found = of_edge[np.argmax(twice)]
        raise InputError(
            f"{places.nodes(mesh, found[:2])} are the ends of an edge with two nodes in its "
            f"middle, one of them {places.node(mesh, int(found[2]))}{places.more(int(twice.sum()))}"
            "; neighbours have to share them (gmsh.model.mesh.removeDuplicateNodes)"
        )
    jacobians = curved_jacobians(mesh.kind, mesh.points[mesh.curved])
    share = jacobians.min(axis=1) / np.abs(jacobians).max(axis=1)
    share = np.maximum(share, (-jacobians).min(axis=1) / np.abs(jacobians).max(axis=1))
    folded = ~(share > _COLLAPSED)
    if folded.any():
        raise InputError(
            f"{places.cell(mesh, int(np.argmax(folded)))} is folded"
            f"{places.more(int(folded.sum()))}: its curved sides meet; take smaller cells there, "
            "or let Gmsh optimise them (gmsh.model.mesh.optimize with HighOrder)"
        )


def _check_sharing(mesh: MeshData, facets: Facets) -> None:
    joined = np.flatnonzero(facets.shared >= 2)
    both, _ = facets.pairs(joined)
    first, second = np.sort(mesh.cells.nodes, axis=1)[both.T]
    same = (first == second).all(axis=1)
    if same.any():
        one, other = sorted(mesh.cells.numbers[both[np.argmax(same)]])
        found = len(np.unique(both[same].max(axis=1)))
        raise InputError(
            f"{mesh.kind.name} {other} is {mesh.kind.name} {one} once more, at "
            f"{places.centre(mesh, mesh.cells, int(both[np.argmax(same), 0]))}: they have the same "
            f"nodes{places.more(found)}; remove the duplicates (gmsh.model.mesh."
            "removeDuplicateElements)"
        )
    many = np.flatnonzero(facets.shared > 2)
    if len(many):
        facet = int(many[0])
        corners = facets.nodes[facet]
        *most, last = map(str, mesh.cells.numbers[facets.cells(facet)])
        what = "edge" if mesh.dim == 2 else "face"
        raise InputError(
            f"{facets.shared[facet]} {mesh.kind.plural} share one {what} "
            f"({places.nodes(mesh, corners)} at {places.at(mesh.points[corners].mean(axis=0))}): "
            f"{', '.join(most)} and {last}{places.more(len(many))}; at most two can, as cells do "
            "not overlap"
        )


def _check_folds(mesh: MeshData, facets: Facets) -> None:
    joined = np.flatnonzero(facets.shared == 2)
    both, opposite = facets.pairs(joined)
    rows = facets.nodes[joined]
    # Three corners tell the side of a face, and both cells have the same three.
    corners = rows[:, : mesh.dim]
    sides = [
        np.sign(signed_measures(mesh.points, np.column_stack([corners, opposite[:, i]])))
        for i in (0, 1)
    ]
    folded = sides[0] * sides[1] > 0
    if folded.any():
        first, second = both[np.argmax(folded)]
        raise InputError(
            f"{places.cell(mesh, int(first))} and its neighbour "
            f"{mesh.cells.numbers[second]} overlap: they lie on one side of what they share "
            f"({places.nodes(mesh, rows[np.argmax(folded)])}){places.more(int(folded.sum()))}; one "
            "of them is turned over"
        )


def _named_facets(
    mesh: MeshData, facets: Facets, warnings: list[str]
) -> tuple[MeshElements, dict[str, str]]:
    """The named facets on the boundary, each once, and why every other group bounds nothing.

    Facets with the same names have a group together.
    """
    given = mesh.facets.take(mesh.facets.groups != 0)
    named = MeshData(mesh.dim, mesh.points, mesh.numbers, mesh.cells, given)
    found = facets.find(given.nodes)
    shared = np.where(found >= 0, facets.shared[found], 0)
    unusable: dict[str, str] = {}
    for name in given.names:
        own = given.named(name)
        off, inner = own & (shared == 0), own & (shared == 2)
        if off.any():
            what = "edge" if mesh.dim == 2 else "face"
            unusable[name] = (
                f"{name!r} does not lie on the body: {places.facet(named, int(np.argmax(off)))} is "
                f"no {what} of a {mesh.kind.name} ({off.sum()} of {own.sum()} such); remove "
                "what dangles, or make it part of the body's mesh (fragment)"
            )
            warnings.append(f"group {unusable[name]}")
        elif inner.sum() == own.sum():
            unusable[name] = (
                f"{name!r} lies inside the body and is not a part of its boundary: "
                f"{places.facet(named, int(np.argmax(own)))} has cells on both sides"
            )
        elif inner.any():
            warnings.append(
                f"group {name!r} is boundary in part only: "
                f"{places.facet(named, int(np.argmax(inner)))} has cells on both sides"
                f"{places.more(int(inner.sum()))}; these facets are left out"
            )
    usable = [name for name in given.names if name not in unusable]
    has_name = np.array([given.named(name) for name in usable]).reshape(len(usable), len(given))
    order = np.flatnonzero((shared == 1) & has_name.any(axis=0))
    _, first, inverse = np.unique(found[order], return_index=True, return_inverse=True)
    names_of = np.zeros((len(first), len(usable)), dtype=bool)
    for column, has in enumerate(has_name[:, order]):
        names_of[inverse[has], column] = True
    together, group = np.unique(names_of, axis=0, return_inverse=True)
    names = {
        name: tuple(int(place) + 1 for place in np.flatnonzero(together[::-1, column]))
        for column, name in enumerate(usable)
    }
    kept = order[first]
    groups = len(together) - group.reshape(-1)
    return MeshElements(given.nodes[kept], given.numbers[kept], groups, names), unusable
