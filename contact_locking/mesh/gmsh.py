"""A mesh file of Gmsh as arrays, and the arrays of a mesh in Gmsh.

A file may come from anybody.  A damaged one can crash Gmsh or fill the memory; Gmsh therefore reads
it in a process of its own first.  Gmsh runs a file that is not a mesh as a Gmsh script, which can
start programs.  For some endings of the name Gmsh starts programs whatever the file holds, and it
passes the names of compressed files to a shell.  A file must therefore begin like a mesh, and Gmsh
reads a copy with a fixed name in a folder of its own.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.files.readable import require_file
from contact_locking.findings import Finding
from contact_locking.mesh.cell_kind import KINDS, CellKind
from contact_locking.mesh.data import ONE_KIND, MeshData, MeshElements, about, flat_points
from contact_locking.meshes import empty_model

# The name of all cells where none has a group.
_WHOLE = "body"


def read(path: Path) -> MeshData:
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
