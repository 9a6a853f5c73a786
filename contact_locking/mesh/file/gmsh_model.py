"""The arrays of a mesh in Gmsh; as a program, which `reader` starts, those of a mesh file."""

from __future__ import annotations

import os
import resource
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.cell_kind import KINDS, CellKind
from contact_locking.mesh.file.data import MeshData, MeshElements
from contact_locking.mesh.file.places import ONE_KIND
from contact_locking.meshes import empty_model

_FLAT = 1e-12  # of the largest coordinate
# The name of all cells where none has a group.
_WHOLE = "body"


def extract(model: Any, origin: str) -> MeshData:
    """The points, the cells and the facets of a model.

    Cells of second order are read by their corners.  Raises InputError, where ``origin`` names the
    mesh, unless the cells are of one kind, and those of a body in 2D in a plane z = constant.
    Cells without any group are one.
    """
    dim = max((d for d, _ in model.getEntities()), default=0)
    if dim < 2:
        raise InputError(f"{origin} is a {dim}D mesh; a body in 2D or 3D is needed")
    if not len(model.mesh.getElementTypes(dim)):
        raise InputError(f"{origin} holds no cells of dimension {dim}; generate the mesh")
    numbers, coordinates, _ = model.mesh.getNodes()
    order = np.argsort(numbers)
    numbers = numbers[order].astype(np.int64)
    points = coordinates.reshape(-1, 3)[order]
    found = [int(number) for number in model.mesh.getElementTypes(dim)]
    if len(found) > 1:
        names = [model.mesh.getElementProperties(number)[0].lower() for number in found]
        raise InputError(f"{origin} has cells of several kinds ({', '.join(names)}); {ONE_KIND}")
    kind = _kind_of(model, found[0])
    if kind is None:
        raise _unsupported(model, origin, found[0], model.mesh.getElements(dim)[1][0][0])
    cells, facets = (_elements(model, k, numbers, origin) for k in (kind, kind.facet))
    if dim == 2:
        height = points[0, 2]
        off = np.abs(points[:, 2] - height) > _FLAT * np.abs(points).max()
        if off.any():
            first = int(np.argmax(off))
            raise InputError(
                f"{origin} is a surface in space; a 2D body lies in a plane z = constant, and node "
                f"{numbers[0]} has z = {height:g}, node {numbers[first]} z = {points[first, 2]:g}"
            )
    if facets.names.keys() & {""} or cells.names.keys() & {""}:
        raise InputError(f"{origin} has a physical group with an empty name")
    if not cells.names:
        ones = np.ones_like(cells.groups)
        cells = MeshElements(cells.nodes, cells.numbers, ones, {_WHOLE: (1,)})
    mesh = MeshData(dim, np.ascontiguousarray(points[:, :dim]), numbers, cells, facets)
    return mesh if found[0] == kind.gmsh else _with_straight_sides(mesh)


def _with_straight_sides(mesh: MeshData) -> MeshData:
    """The mesh of the corners of elements of second order, without their other nodes."""
    parts = (mesh.cells, mesh.facets)
    kept = np.unique(np.concatenate([elements.nodes.reshape(-1) for elements in parts]))
    cells, facets = (
        replace(elements, nodes=np.searchsorted(kept, elements.nodes)) for elements in parts
    )
    told = "its cells are of second order: their corners alone are taken, with straight sides"
    return MeshData(mesh.dim, mesh.points[kept], mesh.numbers[kept], cells, facets, (told,))


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
        raise InputError(
            f"{origin}: the name of physical group {tag} of dimension {dim} is not in UTF-8"
        ) from None
    # Names are printed, and terminals read some characters as commands.
    if not name.isprintable():
        raise InputError(
            f"{origin}: the name of a physical group holds characters that cannot be printed: "
            f"{name!a}"
        )
    return str(name)


# No mesh takes Gmsh so many seconds of the processor.
_LONGEST = 3600


def limit_process() -> None:
    """Let this process have the memory of the machine, and an hour of its processor, at most."""
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, _LONGEST)):
        soft, hard = resource.getrlimit(kind)
        limits = [limit for limit in (most, soft, hard) if limit != resource.RLIM_INFINITY]
        resource.setrlimit(kind, (min(limits), hard))


def main(source: str, target: str, origin: str) -> int:
    """Read the mesh in ``source`` and save its arrays in ``target``; returns the exit code.

    ``origin`` names the mesh for messages.  The message of an InputError is printed.
    """
    import gmsh

    try:
        with empty_model() as model:
            try:
                gmsh.merge(source)
            except Exception as error:  # Gmsh raises Exception itself
                said = str(error).replace(source, origin)
                raise InputError(f"Gmsh cannot read {origin}: {said}") from error
            extract(model, origin).save(Path(target))
    except InputError as error:
        sys.stdout.buffer.write(str(error).encode("utf-8", errors="backslashreplace"))
        return error.exit_code
    return 0


if __name__ == "__main__":
    limit_process()
    sys.exit(main(*sys.argv[1:]))
