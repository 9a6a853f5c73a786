"""A mesh of another program as arrays: cells by their corners, and its sets."""

from __future__ import annotations

import contextlib
import io
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.cell_kind import (
    HEXAHEDRON,
    INTERVAL,
    QUADRILATERAL,
    TETRAHEDRON,
    TRIANGLE,
    CellKind,
)

#: Kinds, None for solids that no body may have, by dimension and nodes of a cell of any order.
KINDS: Mapping[tuple[int, int], CellKind | None] = {
    **dict.fromkeys(((1, 2), (1, 3)), INTERVAL),
    **dict.fromkeys(((2, 3), (2, 6), (2, 7)), TRIANGLE),
    **dict.fromkeys(((2, 4), (2, 8), (2, 9)), QUADRILATERAL),
    **dict.fromkeys(((3, 4), (3, 10)), TETRAHEDRON),
    **dict.fromkeys(((3, 8), (3, 20), (3, 24), (3, 27)), HEXAHEDRON),
    **dict.fromkeys(((3, 5), (3, 6), (3, 13), (3, 15)), None),
}
_DIMENSIONS = {
    **{"line": 1, "triangle": 2, "quad": 2},
    **{"tetra": 3, "hexahedron": 3, "wedge": 3, "pyramid": 3},
}
_INSTALL = "apt-get install python3-meshio, or pip install meshio"
# The modules behind meshio's formats, and their packages.
_PACKAGES = {
    "h5py": "apt-get install python3-h5py, or pip install h5py",
    "netCDF4": "apt-get install python3-netcdf4, or pip install netCDF4",
}


@dataclass(frozen=True)
class Block:
    """Cells that the other program calls by one ``name``.

    ``nodes`` (k, n) are indices of points, the corners first, in the order of Gmsh.
    """

    name: str
    dim: int
    nodes: IntArray

    @property
    def kind(self) -> CellKind | None:
        """The kind of the cells, None for one that no body may have."""
        return KINDS[self.dim, self.nodes.shape[1]]

    @property
    def corners(self) -> IntArray:
        return self.nodes[:, : self.kind.corners] if self.kind is not None else self.nodes


@dataclass
class ForeignMesh:
    """``points`` (m, 2 or 3), blocks of cells, and the sets by their names.

    ``cell_sets`` have numbers of cells, block after block, ``point_sets`` indices of points, and
    ``facet_sets`` lists of facets (f, c) by their corners.  ``left_out`` counts the elements
    that are no cells, such as springs.
    """

    points: FloatArray
    blocks: list[Block]
    cell_sets: dict[str, IntArray] = field(default_factory=dict)
    point_sets: dict[str, IntArray] = field(default_factory=dict)
    facet_sets: dict[str, list[IntArray]] = field(default_factory=dict)
    left_out: Counter[str] = field(default_factory=Counter)


def read(source: Path) -> ForeignMesh:
    """The mesh of a file that meshlane reads, or meshio, which it goes on from."""
    mesh = _read(source)
    found = ForeignMesh(np.asarray(mesh.points, dtype=float), [])
    taken = []
    for number, block in enumerate(mesh.cells):
        dim = _DIMENSIONS.get(re.sub(r"\d", "", block.type), 0)
        nodes = np.asarray(block.data, dtype=np.int64) if dim else np.empty((0, 0), dtype=np.int64)
        if (dim, nodes.shape[1]) in KINDS:
            taken.append(number)
            found.blocks.append(Block(block.type, dim, nodes))
        else:
            found.left_out[block.type] += len(block.data)
    starts = np.cumsum([0, *(len(block.nodes) for block in found.blocks)])
    members = {
        str(name): [np.zeros(0, dtype=np.int64) if rows is None else rows for rows in per_block]
        for name, per_block in mesh.cell_sets.items()
    }
    tags = mesh.cell_data.get("cell_tags")
    for number, names in getattr(mesh, "cell_tags", {}).items():
        for name in names:
            rows = members.setdefault(name, [np.zeros(0, dtype=np.int64) for _ in mesh.cells])
            members[name] = [
                np.union1d(before, np.flatnonzero(values == number))
                for before, values in zip(rows, tags, strict=True)
            ]
    for name, per_block in members.items():
        rows = [start + np.asarray(per_block[k]) for start, k in zip(starts, taken, strict=False)]
        found.cell_sets[name] = np.concatenate([np.zeros(0, dtype=np.int64), *rows]).astype(int)
    found.point_sets = {str(name): np.asarray(rows) for name, rows in mesh.point_sets.items()}
    values = mesh.point_data.get("point_tags")
    for number, names in getattr(mesh, "point_tags", {}).items():
        for name in names:
            before = found.point_sets.get(name, np.zeros(0, dtype=np.int64))
            found.point_sets[name] = np.union1d(before, np.flatnonzero(values == number))
    return found


def _read(source: Path) -> Any:
    try:
        try:
            import meshlane as meshio
        except ImportError:
            import meshio
    except ImportError as error:
        raise InputError(f"meshes of other programs need meshio: {_INSTALL} ({error})") from None
    # meshio prints why a file cannot be read, and then leaves the process.
    told = io.StringIO()
    try:
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
            return meshio.read(source)
    except ImportError as error:
        package = _PACKAGES.get(error.name or "", error.name)
        raise InputError(f"{source} needs the Python module {error.name}: {package}") from None
    except (Exception, SystemExit) as error:
        why = " ".join(told.getvalue().split()) or str(error) or type(error).__name__
        raise InputError(f"{source} cannot be read by {meshio.__name__}: {why}") from None
