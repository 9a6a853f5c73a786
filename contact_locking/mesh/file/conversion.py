"""Meshes of other programs, such as Abaqus, CalculiX, Salome, MOOSE and VTK, written as Gmsh files.

Sets of cells become regions; sets of nodes, surfaces and sets of facets parts of the boundary.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from contact_locking.arrays import BoolArray, IntArray
from contact_locking.errors import InputError, explained
from contact_locking.files.atomic import staging
from contact_locking.mesh.cell_kind import CellKind
from contact_locking.mesh.file import abaqus, foreign
from contact_locking.mesh.file.foreign import ForeignMesh
from contact_locking.meshes.session import check_complete, empty_model

_DECK = ".inp"
#: Of the files of other programs that can be read; meshio reads all but decks.
ENDINGS = frozenset(
    (_DECK, ".bdf", ".cgns", ".e", ".exo", ".fem", ".med", ".mesh", ".nas", ".su2", ".vtk", ".vtu")
)


def convert(source: Path, target: Path) -> list[str]:
    """Write the mesh of ``source``, of another program, as a Gmsh file; returns warnings.

    The cells of the highest dimension are the body, by their corners.  A region is named after the
    sets that its cells are in, joined by +; a set of all cells names those that are in no other
    set, which are else the region "body".  The parts of the boundary are the surfaces, the sets of
    cells of its dimension, and the sets of nodes: the facets with all their nodes in the set.

    Raises InputError for a file that cannot be read, and for cells that are not of one kind.
    """
    if not source.is_file():
        raise InputError(f"there is no such file: {source}")
    mesh = (abaqus if source.suffix.lower() == _DECK else foreign).read(source)
    dim = max((block.dim for block in mesh.blocks), default=0)
    kind = _kind(mesh, dim, source)
    cells, numbers = _of_dimension(mesh, dim)
    regions, names = _regions(mesh.cell_sets, numbers)
    facets = _boundary(cells, kind)
    parts, empty = _parts(mesh, facets, kind.facet)
    _write(target, mesh, (kind, cells, regions, names), parts)
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


def _kind(mesh: ForeignMesh, dim: int, source: Path) -> CellKind:
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


def _of_dimension(mesh: ForeignMesh, dim: int) -> tuple[IntArray, IntArray]:
    """The corners (k, c) of the cells, and for each element of the file its cell there, or -1."""
    cells: list[IntArray] = []
    numbers: list[IntArray] = [np.zeros(0, dtype=np.int64)]
    count = 0
    for block in mesh.blocks:
        found = np.full(len(block.nodes), -1, dtype=np.int64)
        if block.dim == dim:
            found = np.arange(count, count + len(found))
            count += len(found)
            cells.append(block.corners)
        numbers.append(found)
    return np.concatenate(cells), np.concatenate(numbers)


def _regions(sets: Mapping[str, IntArray], numbers: IntArray) -> tuple[IntArray, list[str]]:
    """The number (k,) of each cell's region, from 1, and the names of the regions."""
    count = int(numbers.max(initial=-1)) + 1
    member: dict[str, BoolArray] = {}
    for name, elements in sets.items():
        inside = np.zeros(count, dtype=bool)
        inside[numbers[elements][numbers[elements] >= 0]] = True
        if inside.any():
            member[name] = inside
    parted = {name: inside for name, inside in member.items() if not inside.all()}
    rest = next((name for name in member if name not in parted), "body")
    if not parted:
        return np.ones(count, dtype=np.int64), [rest]
    kinds, found = np.unique(np.column_stack(list(parted.values())), axis=0, return_inverse=True)
    names = ["+".join(np.array(list(parted))[kind]) or rest for kind in kinds]
    return np.asarray(found).reshape(-1) + 1, names


def _boundary(cells: IntArray, kind: CellKind) -> IntArray:
    """The corners (f, d) of the facets of one cell only, in Gmsh's order as those of the cells."""
    every = kind.facets_of(cells[:, list(kind.gmsh_order)])[:, list(kind.facet.gmsh_order)]
    _, first, counts = np.unique(
        np.sort(every, axis=1), axis=0, return_index=True, return_counts=True
    )
    return every[first[counts == 1]]


def _parts(
    mesh: ForeignMesh, facets: IntArray, kind: CellKind
) -> tuple[dict[str, IntArray], list[str]]:
    """The facets of each part of the boundary, and the names of those that have none."""
    place = {key: number for number, key in enumerate(_keys(facets))}

    def on_boundary(found: Iterable[IntArray]) -> list[int]:
        keys = {key for some in found if some.shape[1] == kind.corners for key in _keys(some)}
        return sorted(place[key] for key in keys if key in place)

    parts: dict[str, IntArray] = {}
    empty: list[str] = []
    for name, nodes in mesh.point_sets.items():
        inside = np.zeros(len(mesh.points), dtype=bool)
        inside[nodes] = True
        found = facets[inside[facets].all(axis=1)]
        if len(found):
            parts[name] = found
        elif len(nodes):
            empty.append(name)
    starts = np.cumsum([0, *(len(block.nodes) for block in mesh.blocks)])
    for name, elements in mesh.cell_sets.items():
        chosen = [
            block.corners[elements[(elements >= start) & (elements < end)] - start]
            for block, start, end in zip(mesh.blocks, starts, starts[1:], strict=False)
            if block.dim == kind.dim
        ]
        if rows := on_boundary(chosen):
            parts[name] = facets[rows]
    # A surface says more than a set of its nodes.
    for name, given in mesh.facet_sets.items():
        if rows := on_boundary(given):
            parts[name] = facets[rows]
        else:
            empty.append(name)
    return parts, empty


def _keys(facets: IntArray) -> list[tuple[int, ...]]:
    """The corners of each facet (f, c), in an order that does not depend on the cell."""
    return [tuple(map(int, row)) for row in np.sort(facets, axis=1)]


def _write(
    target: Path,
    mesh: ForeignMesh,
    body: tuple[CellKind, IntArray, IntArray, list[str]],
    parts: Mapping[str, IntArray],
) -> None:
    import gmsh

    kind, cells, regions, names = body
    used = np.unique(cells)
    place = np.zeros(len(mesh.points), dtype=np.int64)
    place[used] = np.arange(1, len(used) + 1)
    space = np.zeros((len(used), 3))
    space[:, : mesh.points.shape[1]] = mesh.points[used]
    groups = [(kind, name, cells[regions == number]) for number, name in enumerate(names, start=1)]
    for name, facets in parts.items():
        groups.append((kind.facet, f"{name} (nodes)" if name in names else name, facets))
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
