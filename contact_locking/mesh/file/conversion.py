"""Decks of Abaqus and CalculiX, written as Gmsh files.

Sets of cells become regions; sets of nodes, surfaces and sets of facets parts of the boundary.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from contact_locking.arrays import BoolArray, IntArray
from contact_locking.errors import InputError, explained
from contact_locking.files.atomic import staging
from contact_locking.mesh.cell_kind import CellKind
from contact_locking.mesh.file import abaqus
from contact_locking.mesh.file.abaqus import DeckMesh
from contact_locking.mesh.file.topology import keys
from contact_locking.meshes.session import check_complete, empty_model

#: The endings of decks.
ENDINGS = (".inp",)

#: A kind of elements, the name of a group, and its elements (k, c) by their corners.
Group = tuple[CellKind, str, IntArray]


def convert(source: Path, target: Path) -> list[str]:
    """Write the mesh of the deck ``source`` as a Gmsh file; returns warnings.

    The cells of the highest dimension are the body, by their corners.  A region is named after the
    sets that its cells are in, joined by +; a set of all cells names those that are in no other
    set, which are else the region "body".  The parts of the boundary are the surfaces, the sets of
    cells of its dimension, and the sets of nodes: the facets with all their nodes in the set.

    Raises InputError for a file that cannot be read, and for cells that are not of one kind.
    """
    if not source.is_file():
        raise InputError(f"there is no such file: {source}")
    mesh = abaqus.read(source)
    dim = max((block.dim for block in mesh.blocks), default=0)
    kind = _kind(mesh, dim, source)
    cells = np.concatenate([block.corners for block in mesh.blocks if block.dim == dim])
    regions = _regions(mesh, kind, cells)
    parts, empty = _parts(mesh, kind, cells)
    names = {name for _, name, _ in regions}
    parts = [(of, f"{name} (nodes)" if name in names else name, x) for of, name, x in parts]
    _write(target, mesh, cells, [*regions, *parts])
    warnings = []
    if any(block.dim == dim and block.nodes.shape[1] > kind.corners for block in mesh.blocks):
        warnings.append("its cells of second order are taken by their corners, with straight sides")
    rest = mesh.left_out + Counter({b.name: len(b.nodes) for b in mesh.blocks if b.dim < dim})
    if rest:
        listed = ", ".join(f"{count} {name}" for name, count in sorted(rest.items()))
        warnings.append(f"its elements of other kinds are left out: {listed}")
    if empty:
        warnings.append(f"these sets have no facet on the boundary: {', '.join(empty)}")
    return [f"{source}: {text}" for text in warnings]


def _kind(mesh: DeckMesh, dim: int, source: Path) -> CellKind:
    """The kind of the body's cells."""
    of_body = [block for block in mesh.blocks if block.dim == dim > 1]
    kinds = {block.kind for block in of_body}
    if len(kinds) == 1 and (kind := kinds.pop()) is not None:
        return kind
    counts = Counter[str]()
    for block in of_body:
        counts[block.name] += len(block.nodes)
    listed = ", ".join(f"{count} {name}" for name, count in (counts or mesh.left_out).items())
    raise InputError(
        f"{source} has the cells {listed or 'none'}; a body has cells of one kind: triangles, "
        "quadrilaterals, tetrahedra or hexahedra; mesh it again with one of them"
    )


def _regions(mesh: DeckMesh, kind: CellKind, cells: IntArray) -> list[Group]:
    """The cells of each region."""
    is_cell = np.concatenate([np.full(len(b.nodes), b.dim == kind.dim) for b in mesh.blocks])
    has: dict[str, BoolArray] = {}
    for name, elements in mesh.cell_sets.items():
        mark = np.zeros(len(is_cell), dtype=bool)
        mark[elements] = True
        if (mark & is_cell).any():
            has[name] = mark[is_cell]
    whole = next((name for name, inside in has.items() if inside.all()), "body")
    parted = {name: inside for name, inside in has.items() if not inside.all()}
    nothing = np.zeros(len(cells), dtype=bool)
    sets, number = np.unique(
        np.column_stack([nothing, *parted.values()]), axis=0, return_inverse=True
    )
    names = ["+".join(np.array(list(parted), dtype=str)[inside[1:]]) or whole for inside in sets]
    return [(kind, name, cells[number.reshape(-1) == k]) for k, name in enumerate(names)]


def _parts(mesh: DeckMesh, kind: CellKind, cells: IntArray) -> tuple[list[Group], list[str]]:
    """The facets of each part of the boundary, and the names of those that have none."""
    count, of = len(mesh.points), kind.facet
    every = kind.facets_of(cells[:, list(kind.gmsh_order)])[:, list(of.gmsh_order)]
    _, first, counts = np.unique(
        keys(np.sort(every, axis=1), count), return_index=True, return_counts=True
    )
    facets = every[first[counts == 1]]
    boundary = keys(np.sort(facets, axis=1), count)

    def on_boundary(rows: Sequence[IntArray]) -> IntArray:
        fitting = [np.sort(some, axis=1) for some in rows if some.shape[1] == of.corners]
        known = [keys(some, count) for some in fitting if len(some)]
        return facets[np.isin(boundary, np.concatenate(known))] if known else facets[:0]

    found: dict[str, IntArray] = {}
    for name, nodes in mesh.point_sets.items():
        inside = np.zeros(count, dtype=bool)
        inside[nodes] = True
        found[name] = facets[inside[facets].all(axis=1)]
    empty = [name for name, rows in found.items() if not len(rows) and len(mesh.point_sets[name])]
    starts = np.cumsum([0, *(len(block.nodes) for block in mesh.blocks)])
    for name, elements in mesh.cell_sets.items():
        chosen = [
            block.corners[elements[(elements >= start) & (elements < end)] - start]
            for block, start, end in zip(mesh.blocks, starts, starts[1:], strict=False)
            if block.dim == of.dim
        ]
        if len(rows := on_boundary(chosen)):
            found[name] = rows
    # A surface says more than a set of its nodes.
    for name, given in mesh.facet_sets.items():
        if len(rows := on_boundary(given)):
            found[name] = rows
        else:
            empty.append(name)
    return [(of, name, rows) for name, rows in found.items() if len(rows)], empty


def _write(target: Path, mesh: DeckMesh, cells: IntArray, groups: Sequence[Group]) -> None:
    import gmsh

    used = np.unique(cells)
    place = np.zeros(len(mesh.points), dtype=np.int64)
    place[used] = np.arange(1, len(used) + 1)
    space = np.zeros((len(used), 3))
    space[:, : mesh.points.shape[1]] = mesh.points[used]
    with explained(f"cannot write {target}", target), staging(target.parent) as folder:
        path = folder / "mesh.msh"
        path.touch()
        with empty_model() as model:
            # Numbers in text form would lose a digit.
            gmsh.option.setNumber("Mesh.Binary", 1)
            for number, (of, name, rows) in enumerate(groups, start=1):
                model.addDiscreteEntity(of.dim, number)
                if number == 1:
                    model.mesh.addNodes(of.dim, 1, place[used], space.reshape(-1))
                model.mesh.addElementsByType(number, of.gmsh, [], place[rows].reshape(-1))
                model.addPhysicalGroup(of.dim, [number], number, name.replace('"', "'"))
            gmsh.write(str(path))
        check_complete(path)
        path.replace(target)
