"""Mesh files of Gmsh and in XDMF as arrays, and the arrays of a mesh in Gmsh.

A file may come from anybody.  A damaged one can crash Gmsh or fill the memory; Gmsh therefore reads
it in a process of its own first.  Gmsh runs a file that is not a mesh as a Gmsh script, which can
start programs.  For some endings of the name Gmsh starts programs whatever the file holds, and it
passes the names of compressed files to a shell.  A file must therefore begin like a mesh, and Gmsh
reads a copy with a fixed name in a folder of its own.

XDMF is read as DOLFINx and meshio write it.  The numbers are in an HDF5 file beside the file, which
has the same name with the ending .h5.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree import ElementTree

import numpy as np

from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.files import require_file
from contact_locking.findings import Finding
from contact_locking.mesh.data import (
    INTERVAL,
    KINDS,
    NAMED,
    ONE_KIND,
    CellKind,
    MeshData,
    MeshElements,
    about,
    and_more,
    data_file,
    flat_points,
    keys,
    named_elements,
)
from contact_locking.meshes import empty_model

# The name of all cells where none has a group.
_WHOLE = "body"


def read_gmsh(path: Path) -> MeshData:
    """The arrays of a mesh file, not checked yet; for one process.

    Raises InputError with the name of the file if it is not a mesh or cannot be read.
    """
    import gmsh

    with trusted_copy(path) as copy, empty_model() as model:
        _require_readable(copy, path)
        gmsh.merge(str(copy))
        return extract(model, str(path))


# With these environment variables of an MPI launcher a process counts as a rank.
_LAUNCHERS = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_LOCAL", "HYDRA_")
_TRIAL = """
import contextlib, gmsh, os, resource, sys
with contextlib.suppress(ValueError):  # the system has a lower limit
    resource.setrlimit(resource.RLIMIT_AS, (2**33 + 100 * os.path.getsize(sys.argv[1]),) * 2)
gmsh.initialize(readConfigFiles=False)
gmsh.merge(sys.argv[1])
"""


def _require_readable(copy: Path, path: Path) -> None:
    """Raise InputError if a process that reads the copy with Gmsh, in 8 GB and more, fails."""
    words = [sys.executable, "-P", "-c", _TRIAL, str(copy)]
    kept = {name: os.environ[name] for name in os.environ if not name.startswith(_LAUNCHERS)}
    done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, env=kept)
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().rpartition("\n")[-1]
        why = said.replace(str(copy), str(path)) or f"it crashes ({done.returncode})"
        raise InputError(f"Gmsh cannot read {path}: {why}")


def extract(model: Any, origin: str) -> MeshData:
    """The points, the cells and the facets of a model.

    Cells of second order are read by their corners.  Raises InputError, where ``origin`` names the
    mesh, unless the cells are of one kind, and those of a body in 2D in a plane z = constant.
    Cells without any group are one.
    """
    dim = max((d for d, _ in model.getEntities()), default=0)
    if dim < 2 or not len(model.mesh.getElementTypes(dim)):
        raise InputError(f"{origin} holds no cells of a body in 2D or 3D; generate the mesh")
    numbers, coordinates, _ = model.mesh.getNodes()
    order = np.argsort(numbers)
    numbers = numbers[order].astype(np.int64)
    points = coordinates.reshape(-1, 3)[order]
    types = [int(number) for number in model.mesh.getElementTypes(dim)]
    kind = _kind_of(model, types[0])
    if kind is None:
        raise _unsupported(model, origin, types[0], model.mesh.getElements(dim)[1][0][0])
    cells, facets = (_elements(model, k, numbers, origin) for k in (kind, kind.facet))
    if not cells.names:
        ones = np.ones_like(cells.groups)
        cells = MeshElements(cells.nodes, cells.numbers, ones, {_WHOLE: (1,)})
    with about(origin):
        flat = flat_points(points, numbers, dim)
    mesh = MeshData(dim, flat, numbers, cells, facets)
    return mesh if types == [kind.gmsh] else _with_straight_sides(mesh)


def _with_straight_sides(mesh: MeshData) -> MeshData:
    """The mesh of the corners of elements of second order, without their other nodes."""
    parts = (mesh.cells, mesh.facets)
    kept = np.unique(np.concatenate([elements.nodes.reshape(-1) for elements in parts]))
    cells, facets = (
        replace(elements, nodes=np.searchsorted(kept, elements.nodes)) for elements in parts
    )
    findings = (Finding("mesh.second_order"),)
    return MeshData(mesh.dim, mesh.points[kept], mesh.numbers[kept], cells, facets, findings)


def _kind_of(model: Any, number: int) -> CellKind | None:
    """The kind of elements of this number in Gmsh, None beyond the second order."""
    _, dim, order, _, _, corners = model.mesh.getElementProperties(number)
    return KINDS.get((dim, corners)) if order <= 2 else None


def _elements(model: Any, kind: CellKind, node_numbers: IntArray, origin: str) -> MeshElements:
    """The elements of one kind: group after group, then the elements without a group.

    A facet is there once for each of its groups.  Raises InputError for elements of the dimension
    and another kind.
    """
    dim, order = kind.dim, list(kind.gmsh_order)
    names: dict[str, tuple[int, ...]] = {}
    owner: dict[int, str] = {}
    nodes: list[IntArray] = [np.empty((0, kind.corners), dtype=np.int64)]
    numbers: list[IntArray] = [np.empty(0, dtype=np.int64)]
    groups: list[IntArray] = [np.empty(0, dtype=np.int64)]

    def add(entity: int, group: int) -> None:
        for number, tags, corners in zip(*model.mesh.getElements(dim, entity), strict=True):
            if _kind_of(model, number) is not kind:
                raise _unsupported(model, origin, number, tags[0])
            numbers.append(tags.astype(np.int64))
            rows = np.searchsorted(node_numbers, corners.astype(np.int64))
            # The corners come first.
            nodes.append(rows.reshape(len(tags), -1)[:, order])
            groups.append(np.full(len(tags), group, dtype=np.int64))

    for _, tag in model.getPhysicalGroups(dim):
        name = _name(model, dim, tag, origin)
        if name in names:
            raise InputError(f"{origin} has two physical groups of dimension {dim} named {name!r}")
        names[name] = (int(tag),)
        for entity in map(int, model.getEntitiesForPhysicalGroup(dim, tag)):
            if entity in owner and dim == model.getDimension():
                raise InputError(
                    f"{origin}: physical groups {owner[entity]!r} and {name!r} share an entity; "
                    "let each region have one name"
                )
            owner[entity] = name
            add(entity, int(tag))
    for _, entity in model.getEntities(dim):
        if int(entity) not in owner:
            add(int(entity), 0)
    return MeshElements(
        np.concatenate(nodes), np.concatenate(numbers), np.concatenate(groups), names
    )


def _unsupported(model: Any, origin: str, number: int, element: int) -> InputError:
    """Why elements of this number in Gmsh are not read, and the way out."""
    shape = model.mesh.getElementProperties(number)[0]
    return InputError(
        f"{origin}: element {element} is a {shape} in Gmsh's words; cells are of first or second "
        f"order (gmsh.model.mesh.setOrder(1) before the mesh is saved), and {ONE_KIND}"
    )


def _name(model: Any, dim: int, tag: int, origin: str) -> str:
    try:
        name = model.getPhysicalName(dim, tag) or str(tag)
    except UnicodeDecodeError:
        raise InputError(f"{origin}: the name of physical group {tag} is not in UTF-8") from None
    # Names are printed, and terminals read some characters as commands.
    if not name.isprintable():
        raise InputError(
            f"{origin}: the name of a physical group holds characters that cannot be printed: "
            f"{name!a}"
        )
    return str(name)


# The first two lines of a mesh: "$MeshFormat", then version, 0 (text) or 1 (binary), and size.
_BEGIN = re.compile(
    rb"\$MeshFormat[ \t]*\r?\n[ \t]*(2|2\.1|2\.2|4|4\.0|4\.1)[ \t]+[01][ \t]+\d+[ \t]*\r?\n"
)
_BEGIN_LENGTH = 200


@contextmanager
def trusted_copy(path: Path) -> Iterator[Path]:
    """A copy of the mesh file that Gmsh can read as a mesh only; it lasts until the block ends.

    Raises InputError unless the path is a file in Gmsh's mesh format (MSH 2 or 4).
    """
    require_file(path)
    with tempfile.TemporaryDirectory(prefix="contact-locking-") as folder:
        copy = Path(folder, "mesh.msh")
        with path.open("rb") as source, copy.open("wb") as target:
            _check_begin(source, path)
            shutil.copyfileobj(source, target, 1 << 20)
        yield copy


def _check_begin(stream: BinaryIO, path: Path) -> None:
    begin = stream.read(_BEGIN_LENGTH)
    stream.seek(0)
    if not _BEGIN.match(begin):
        raise InputError(
            f"{path} is not a mesh in version 2.2, 4.0 or 4.1 of Gmsh's format, which begins with "
            "$MeshFormat; in Gmsh, save the mesh as .msh (File > Export, or gmsh.write, with "
            "Mesh.MshFileVersion); a .geo script is not run here, as it can start programs"
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


def read_xdmf(path: Path) -> MeshData:
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
            f"{path} needs its numbers in {data.name}, in the same folder: write it with "
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
        raise InputError(f"the name of a grid is {name!a}, which is not valid")
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


def _array(element: ElementTree.Element, tag: str, file: Any) -> Any:
    data_item = element.find(f"{tag}/DataItem")
    return file[(("" if data_item is None else data_item.text) or "").strip().partition(":")[2]][()]


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
