"""Exodus files of MOOSE and Cubit: blocks are regions, sets of sides parts of the boundary."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.file.foreign import KINDS, Block, ForeignMesh, facets_at, missing

# The dimension of elements by the letters with which their type begins.
_DIMENSIONS = {"TRI": 2, "QUA": 2, "SHE": 2, "TET": 3, "HEX": 3, "WED": 3, "PYR": 3}
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0))
_FACES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": _EDGES,
    "tetrahedron": ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    "hexahedron": (
        *((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6)),
        *((0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
    ),
}


def read(source: Path) -> ForeignMesh:
    """The mesh of an Exodus file.  Raises InputError if it cannot be read."""
    try:
        import netCDF4
    except ImportError as error:
        raise missing(error, source) from None
    try:
        with netCDF4.Dataset(source) as data:
            data.set_auto_mask(False)
            return _mesh(data)
    except (OSError, KeyError, IndexError, ValueError) as error:
        raise InputError(f"{source} cannot be read as an Exodus file: {error}") from None


def _mesh(data: Any) -> ForeignMesh:
    values, sizes = data.variables, {name: len(size) for name, size in data.dimensions.items()}
    axes = [values[f"coord{axis}"][:] for axis in "xyz" if f"coord{axis}" in values]
    points = np.column_stack(axes) if axes else values["coord"][:].T
    found = ForeignMesh(np.asarray(points, dtype=float), [])
    # Numbers of elements count those that are left out, too.
    number = np.full(sizes.get("num_elem", 0) + 1, -1)
    first = total = 0
    for index, name in enumerate(_names(data, "eb", "num_el_blk"), start=1):
        connect = values.get(f"connect{index}")
        if connect is None:
            continue
        nodes = np.asarray(connect[:], dtype=np.int64) - 1
        kind = str(connect.elem_type).upper()
        dim = _DIMENSIONS.get(re.sub(r"[^A-Z]", "", kind)[:3], 0)
        count = len(nodes)
        if (dim, nodes.shape[1]) in KINDS:
            number[first + 1 : first + 1 + count] = np.arange(total, total + count)
            found.cell_sets[name] = np.arange(total, total + count)
            found.blocks.append(Block(kind, dim, nodes))
            total += count
        else:
            found.left_out[kind] += count
        first += count
    for index, name in enumerate(_names(data, "ns", "num_node_sets"), start=1):
        if f"node_ns{index}" in values:
            found.point_sets[name] = np.asarray(values[f"node_ns{index}"][:], dtype=np.int64) - 1
    for index, name in enumerate(_names(data, "ss", "num_side_sets"), start=1):
        if f"elem_ss{index}" in values:
            cells: IntArray = number[values[f"elem_ss{index}"][:]]
            sides: IntArray = np.asarray(values[f"side_ss{index}"][:], dtype=np.int64) - 1
            found.facet_sets[name] = facets_at(found.blocks, cells, sides, _FACES)
    return found


def _names(data: Any, kind: str, count: str) -> list[str]:
    """The name of each block or set, its number where it has none."""
    if count not in data.dimensions:
        return []
    number = len(data.dimensions[count])
    table = data.variables.get(f"{kind}_names")
    named = [""] * number
    if table is not None:
        named = [
            b"".join(row).split(b"\0")[0].decode("utf-8", "replace").strip() for row in table[:]
        ]
    given = data.variables.get(f"{kind}_prop1")
    ids = range(1, number + 1) if given is None else given[:]
    return [name or str(one) for name, one in zip(named, ids, strict=True)]
