"""Meshes of other programs, such as Abaqus, CalculiX, Nastran and VTK, written as Gmsh files.

meshio reads them.  Sets of cells become regions, and sets of nodes become parts of the boundary.
"""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from contact_locking.arrays import BoolArray, IndexArray, IntArray
from contact_locking.errors import InputError, explained
from contact_locking.files.atomic import staging
from contact_locking.mesh.cell_kind import (
    HEXAHEDRON,
    QUADRILATERAL,
    TETRAHEDRON,
    TRIANGLE,
    CellKind,
)

#: Of files of other programs that meshio reads.
ENDINGS = frozenset(
    (".bdf", ".cgns", ".e", ".exo", ".fem", ".inp", ".med", ".mesh", ".nas", ".su2", ".vtk", ".vtu")
)
_INSTALL = "apt-get install python3-meshio, or pip install meshio"
#: The kinds of cells by meshio's names, whose corners are in Gmsh's order, and those of facets.
_CELL_KINDS = {
    "triangle": TRIANGLE,
    "quad": QUADRILATERAL,
    "tetra": TETRAHEDRON,
    "hexahedron": HEXAHEDRON,
}
_FACETS = {"triangle": "line", "quad": "line", "tetra": "triangle", "hexahedron": "quad"}
# Elements of Abaqus in the plane; meshio knows those of plane stress alone.
_TYPES = re.compile(rb"(TYPE\s*=\s*)(?:CP[ES]|CPEG|C?G?AX)([34])[A-Z]*\b", re.IGNORECASE)
# The names of all cells with that many dimensions begin so, of any order.
_CELLS = {3: ("tetra", "hexahedron", "wedge", "pyramid", "polyhedron"), 2: ("triangle", "quad")}


def convert(source: Path, target: Path) -> list[str]:
    """Write the mesh of ``source``, in a format of meshio, as a Gmsh file; returns warnings.

    A region is named after the sets that its cells are in, joined by +; a set of all cells names
    those that are in no other set, which are else the region "body".  A set of nodes is the part of
    the boundary whose facets have all their nodes in the set.

    Raises InputError for a file that meshio cannot read, and for cells that are not of one kind and
    of first order.
    """
    mesh = _read(source)
    dim, kind = _kind(sorted(mesh.cells_dict), source)
    blocks = [(i, block.data) for i, block in enumerate(mesh.cells) if block.type == kind]
    cells: IntArray = np.concatenate([data for _, data in blocks]).astype(np.int64)
    others = sorted(set(mesh.cells_dict) - {kind})
    warnings = [f"{source}: its cells of other kinds ({', '.join(others)}) are left out"] * bool(
        others
    )
    regions, names = _regions(mesh, [i for i, _ in blocks], len(cells))
    facets = _boundary(cells, _CELL_KINDS[kind])
    parts: dict[str, IntArray] = {}
    for name, nodes in mesh.point_sets.items():
        inside = np.zeros(len(mesh.points), dtype=bool)
        inside[nodes] = True
        if len(found := facets[inside[facets].all(axis=1)]):
            parts[str(name)] = found
        else:
            warnings.append(f"{source}: the set {name} of nodes has no facet on the boundary")
    _write(target, mesh.points, dim, (kind, cells, regions, names), (_FACETS[kind], parts))
    return warnings


def _kind(there: list[str], source: Path) -> tuple[int, str]:
    for dim, begins in _CELLS.items():
        cells = [name for name in there if name.startswith(begins)]
        if len(cells) == 1 and cells[0] in _CELL_KINDS:
            return dim, cells[0]
        if cells:
            break
    raise InputError(
        f"{source} has the cells {', '.join(there) or 'none'}; a body has cells of one kind, "
        f"{', '.join(_CELL_KINDS)}, of first order"
    )


def _read(source: Path) -> Any:
    try:
        import meshio
    except ImportError as error:
        raise InputError(f"meshes of other programs need meshio: {_INSTALL} ({error})") from None
    if not source.is_file():
        raise InputError(f"there is no such file: {source}")
    # meshio prints why a file cannot be read, and then leaves the process.
    told = io.StringIO()
    try:
        with (
            tempfile.TemporaryDirectory(prefix="contact-locking-") as folder,
            contextlib.redirect_stdout(told),
            contextlib.redirect_stderr(told),
        ):
            readable = source
            if source.suffix == ".inp":
                readable = Path(folder, source.name)
                readable.write_bytes(_TYPES.sub(rb"\1CPS\2", source.read_bytes()))
            return meshio.read(readable)
    except (Exception, SystemExit) as error:
        why = " ".join(told.getvalue().split()) or str(error) or type(error).__name__
        raise InputError(f"{source} cannot be read by meshio: {why}") from None


def _regions(mesh: Any, blocks: list[int], count: int) -> tuple[IntArray, list[str]]:
    """The number (count,) of each cell's region, from 1, and the names of the regions."""
    member: dict[str, BoolArray] = {}
    starts = np.cumsum([0, *(len(mesh.cells[i].data) for i in blocks)])
    for name, found in mesh.cell_sets.items():
        inside = np.zeros(count, dtype=bool)
        for start, block in zip(starts, blocks, strict=False):
            if found[block] is not None:
                inside[start + np.asarray(found[block], dtype=np.int64)] = True
        if inside.any():
            member[str(name)] = inside
    parted = {name: inside for name, inside in member.items() if not inside.all()}
    rest = next((name for name in member if name not in parted), "body")
    if not parted:
        return np.ones(count, dtype=np.int64), [rest]
    kinds, numbers = np.unique(np.column_stack(list(parted.values())), axis=0, return_inverse=True)
    names = ["+".join(np.array(list(parted))[kind]) or rest for kind in kinds]
    return np.asarray(numbers).reshape(-1) + 1, names


def _boundary(cells: IntArray, kind: CellKind) -> IntArray:
    """The corners (f, d) of the facets of one cell only, in Gmsh's order as those of the cells."""
    every = kind.facets_of(cells[:, list(kind.gmsh_order)])[:, list(kind.facet.gmsh_order)]
    _, first, counts = np.unique(
        np.sort(every, axis=1), axis=0, return_index=True, return_counts=True
    )
    return every[first[counts == 1]]


def _write(
    target: Path,
    points: Any,
    dim: int,
    body: tuple[str, IntArray, IntArray, list[str]],
    boundary: tuple[str, Mapping[str, IntArray]],
) -> None:
    import meshio

    kind, cells, regions, names = body
    facet, parts = boundary
    blocks, tags = [(kind, cells)], [regions]
    fields = {name: np.array([number, dim]) for number, name in enumerate(names, start=1)}
    for number, (name, facets) in enumerate(parts.items(), start=len(names) + 1):
        blocks.append((facet, facets))
        tags.append(np.full(len(facets), number))
        fields[name if name not in fields else f"{name} (nodes)"] = np.array([number, dim - 1])
    numbered = [values.astype(np.int32) for values in tags]
    used: IndexArray = np.unique(cells).astype(np.int32)
    place = np.zeros(len(points), dtype=np.int64)
    place[used] = np.arange(len(used))
    space = np.zeros((len(used), 3))
    space[:, : points.shape[1]] = points[used]
    written = meshio.Mesh(
        space,
        [(name, place[nodes]) for name, nodes in blocks],
        cell_data={"gmsh:physical": numbered, "gmsh:geometrical": numbered},
        field_data=fields,
    )
    with explained(f"cannot write {target}", target), staging(target.parent) as folder:
        written.write(folder / "mesh.msh", file_format="gmsh22", binary=False)
        (folder / "mesh.msh").replace(target)
