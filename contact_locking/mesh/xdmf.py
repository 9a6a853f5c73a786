"""The mesh of the body in an XDMF file, as DOLFINx and meshio write it.

The numbers are in an HDF5 file beside the file, which has the same name with the ending .h5.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.files.readable import require_file
from contact_locking.mesh.cell_kind import INTERVAL, NAMED, CellKind, keys
from contact_locking.mesh.data import (
    MeshData,
    MeshElements,
    and_more,
    data_file,
    flat_points,
    named_elements,
)

_KINDS = {"polyline": INTERVAL, **NAMED}


@dataclass(frozen=True)
class Grid:
    """Elements of one kind under one name: their ``nodes`` (k, n), and the tags (k,) if any."""

    name: str
    kind: CellKind
    nodes: IntArray
    tags: IntArray | None

    def groups(self) -> Iterator[tuple[str, IntArray]]:
        """The name of each group with its elements."""
        values = np.unique(self.tags) if self.tags is not None else np.empty(0)
        if len(values) < 2:
            yield self.name, self.nodes
            return
        yield from ((str(value), self.nodes[self.tags == value]) for value in values)


def read(path: Path) -> MeshData:
    """The mesh of a file, not checked yet; for one process.

    The first grid of the file is the mesh.  Every other grid has tags of cells or facets.  Tags
    with one value are a group with the name of the grid.  Of tags with several values each value
    is a group, whose name is the number.  Cells without any tags are one region with the name of
    the mesh.

    Raises InputError if the file cannot be read, and if the cells are not of one kind and first
    order.
    """
    try:
        import h5py
    except ImportError as error:
        raise InputError(f"{path} is read with h5py: pip install h5py ({error})") from None
    require_file(path)
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise InputError(f"{path} is not an XML file: {error}") from None
    data = data_file(path)
    sources = [(element.text or "").strip().partition(":")[0] for element in root.iter("DataItem")]
    if not data.exists() or any(source != data.name for source in sources):
        raise InputError(
            f"{path} does not have its numbers in {data.name} beside it: write it with "
            "dolfinx.io.XDMFFile, or with meshio and data_format='HDF'"
        )
    try:
        with h5py.File(data, "r") as file:
            elements = root.findall("Domain/Grid")
            grids = [_grid(element, file) for element in elements]
            if not grids:
                raise InputError("it holds no grid; write the mesh first")
            return _mesh(grids, _array(elements[0], "Geometry", file))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} cannot be read with {data.name}: {error}") from error


def _grid(element: ElementTree.Element, file: Any) -> Grid:
    name, topology = element.get("Name", ""), element.find("Topology")
    word = "" if topology is None else topology.get("TopologyType", "")
    # Names are printed, and terminals read some characters as commands.
    if not name or not name.isprintable():
        raise InputError(f"the name of a grid is {name!a}, which is no name")
    if (kind := _KINDS.get(word.lower())) is None:
        known = ", ".join(kind.plural for kind in NAMED.values())
        raise InputError(
            f"grid {name!r} has the topology {word!a}; write cells of one kind and of first order "
            f"({known}), and tags of them and of their facets"
        )
    nodes = np.asarray(_array(element, "Topology", file), dtype=np.int64)
    if nodes.shape[1:] != (kind.corners,):
        raise InputError(f"the sizes of its arrays are not those of a mesh of {kind.plural}")
    has_tags = element.find("Attribute") is not None
    tags = np.asarray(_array(element, "Attribute", file)).reshape(-1) if has_tags else None
    return Grid(name, kind, nodes[:, list(kind.gmsh_order)], tags)


def _array(element: ElementTree.Element, part: str, file: Any) -> Any:
    item = element.find(f"{part}/DataItem")
    return file[(("" if item is None else item.text) or "").strip().partition(":")[2]][()]


def _mesh(grids: Sequence[Grid], coordinates: Any) -> MeshData:
    """The mesh of the first grid, with the groups of the others."""
    body, kind, names = grids[0], grids[0].kind, [grid.name for grid in grids]
    if kind.dim < 2 or not len(body.nodes):
        raise InputError("the mesh holds no cells of a body in 2D or 3D")
    for grid in grids:
        if names.count(grid.name) > 1:
            raise InputError(f"it has two grids with one name, {grid.name!r}")
        if grid.kind not in (kind, kind.facet):
            raise InputError(
                f"grid {grid.name!r} has neither {kind.plural} nor {kind.facet_word}s of the body"
            )
        outside = ((grid.nodes < 0) | (grid.nodes >= len(coordinates))).any(axis=1)
        if outside.any():
            raise InputError(
                f"{grid.kind.name} {int(np.argmax(outside))} names nodes that are none of its "
                f"{len(coordinates)}{and_more(int(outside.sum()))}"
            )
    if unused := len(coordinates) - len(np.unique(body.nodes)):
        raise InputError(
            f"{unused} of its {len(coordinates)} nodes belong to no cell; write the nodes of cells "
            "alone"
        )
    inside, around = (
        [group for grid in grids[1:] if grid.kind is of for group in grid.groups()]
        for of in (kind, kind.facet)
    )
    for groups, what in ((inside, "cells"), (around, "facets")):
        different = {name for name, _ in groups}
        if len(different) < len(groups):
            raise InputError(f"it has two groups of {what} with one name")
    numbers = np.arange(len(coordinates))
    points = flat_points(np.asarray(coordinates, dtype=float), numbers, kind.dim)
    return MeshData(
        kind.dim, points, numbers, _regions(body, inside), named_elements(kind.facet, dict(around))
    )


def _regions(body: Grid, groups: Sequence[tuple[str, IntArray]]) -> MeshElements:
    """The cells of the body, each in one of the groups."""
    count, size = len(body.nodes), int(body.nodes.max()) + 1
    region = np.zeros(count, dtype=np.int64)
    values = keys(np.sort(body.nodes, axis=1), size)
    order = np.argsort(values)
    for number, (name, nodes) in enumerate(groups, start=1):
        places = np.searchsorted(values[order], keys(np.sort(nodes, axis=1), size))
        cells = order[np.minimum(places, count - 1)]
        if (both := region[cells]).any():
            first, other = sorted((name, groups[both.max() - 1][0]))
            raise InputError(
                f"groups {first!r} and {other!r} share cells; let each region have one name"
            )
        region[cells] = number
    names = {name: (number,) for number, (name, _) in enumerate(groups, start=1)}
    if not names:
        region, names = np.ones_like(region), {body.name: (1,)}
    return MeshElements(body.nodes, np.arange(count), region, names)
