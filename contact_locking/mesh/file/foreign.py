"""A mesh of another program as arrays: cells by their corners, and its sets."""

from __future__ import annotations

import contextlib
import io
import re
from collections import Counter, defaultdict
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

    points: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    blocks: list[Block] = field(default_factory=list)
    cell_sets: dict[str, IntArray] = field(default_factory=dict)
    point_sets: dict[str, IntArray] = field(default_factory=dict)
    facet_sets: dict[str, list[IntArray]] = field(default_factory=dict)
    left_out: Counter[str] = field(default_factory=Counter)

    @property
    def count(self) -> int:
        """The number of cells of all blocks."""
        return sum(len(block.nodes) for block in self.blocks)


def read(source: Path) -> ForeignMesh:
    """The mesh of a file that meshio reads.  Raises InputError."""
    mesh = _read_by_meshio(source)
    found = ForeignMesh(np.asarray(mesh.points, dtype=float))
    first: dict[int, int] = {}  # the first cell of each block that is one here
    for number, block in enumerate(mesh.cells):
        dim = _DIMENSIONS.get(re.sub(r"\d", "", block.type), 0)
        nodes = np.asarray(block.data, dtype=np.int64) if dim else np.empty((0, 0), dtype=np.int64)
        if (dim, nodes.shape[1]) in KINDS:
            first[number] = found.count
            found.blocks.append(Block(block.type, dim, nodes))
        else:
            found.left_out[block.type] += len(block.data)
    of_cells, of_points = defaultdict[str, list[Any]](list), defaultdict[str, list[Any]](list)
    for name, rows in mesh.point_sets.items():
        of_points[str(name)].append(rows)
    for name, per_block in mesh.cell_sets.items():
        rows = [at + np.asarray(per_block[k], dtype=np.int64) for k, at in first.items()
                if per_block[k] is not None]  # fmt: skip
        of_cells[str(name)] += rows
    # Groups of Salome are tags that stand for several names.
    for tag, names in getattr(mesh, "point_tags", {}).items():
        for name in names:
            of_points[name].append(np.flatnonzero(mesh.point_data["point_tags"] == tag))
    for tag, names in getattr(mesh, "cell_tags", {}).items():
        tags = mesh.cell_data["cell_tags"]
        for name in names:
            of_cells[name] += [at + np.flatnonzero(tags[k] == tag) for k, at in first.items()]
    for members, sets in ((of_cells, found.cell_sets), (of_points, found.point_sets)):
        sets |= {
            name: np.unique(np.concatenate([[], *x])).astype(int) for name, x in members.items()
        }
    return found


def _read_by_meshio(source: Path) -> Any:
    # meshio prints why a file cannot be read, and then leaves the process.
    told = io.StringIO()
    try:
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
            import meshio

            return meshio.read(source)
    except ImportError as error:
        module = error.name or "meshio"
        install = f"apt-get install python3-{module.lower()}, or pip install {module}"
        raise InputError(f"{source} needs the Python module {module}: {install}") from None
    except (Exception, SystemExit) as error:
        why = " ".join(told.getvalue().split()) or str(error) or type(error).__name__
        raise InputError(f"{source} cannot be read by meshio: {why}") from None
