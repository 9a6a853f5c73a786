"""The arrays of a mesh in Gmsh; as a program, which `reader` starts, those of a mesh file."""

from __future__ import annotations

import os
import resource
import sys
from pathlib import Path
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.mesh.file.data import MeshData, Simplices
from contact_locking.meshes import empty_model

# The numbers of the first-order simplices in Gmsh, by dimension.
_SIMPLEX = {1: 1, 2: 2, 3: 4}
_PLURAL = {1: "lines", 2: "triangles", 3: "tetrahedra"}
_FLAT = 1e-12  # of the largest coordinate


def extract(model: Any, origin: str) -> MeshData:
    """The points, the cells and the facets of a model.

    Raises InputError, where ``origin`` names the mesh, unless the cells are first-order triangles
    in the plane z = 0 or first-order tetrahedra.
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
    cells, facets = (_simplices(model, d, numbers, origin) for d in (dim, dim - 1))
    if dim == 2:
        off = np.abs(points[:, 2]) > _FLAT * np.abs(points).max()
        if off.any():
            first = int(np.argmax(off))
            raise InputError(
                f"{origin} is a surface in space; a 2D body lies in z = 0, and node "
                f"{numbers[first]} has z = {points[first, 2]:g}"
            )
    if facets.names.keys() & {""} or cells.names.keys() & {""}:
        raise InputError(f"{origin} has a physical group with an empty name")
    return MeshData(dim, np.ascontiguousarray(points[:, :dim]), numbers, cells, facets)


def triangles(model: Any, origin: str) -> FloatArray:
    """The corners (n, 3, 3) of all triangles of the surfaces of a model.

    Raises InputError for surfaces without triangles, and for elements of other kinds.
    """
    numbers, coordinates, _ = model.mesh.getNodes()
    order = np.argsort(numbers)
    found = []
    for kind, tags, nodes in zip(*model.mesh.getElements(2), strict=True):
        if kind != _SIMPLEX[2]:
            raise InputError(f"{origin}: {_unsupported(model, 2, kind, tags[0])}")
        rows = np.searchsorted(numbers[order], nodes)
        found.append(coordinates.reshape(-1, 3)[order][rows].reshape(-1, 3, 3))
    if not found:
        raise InputError(f"{origin} holds no triangles")
    return np.concatenate(found)


def _simplices(model: Any, dim: int, node_numbers: IntArray, origin: str) -> Simplices:
    """The elements of one dimension: group after group, then the elements without a group.

    A facet is there once for each of its groups.
    """
    names: dict[str, tuple[int, ...]] = {}
    owner: dict[int, str] = {}
    nodes: list[IntArray] = [np.empty((0, dim + 1), dtype=np.int64)]
    numbers: list[IntArray] = [np.empty(0, dtype=np.int64)]
    groups: list[IntArray] = [np.empty(0, dtype=np.int64)]

    def add(entity: int, group: int) -> None:
        for kind, tags, corners in zip(*model.mesh.getElements(dim, entity), strict=True):
            if kind != _SIMPLEX[dim]:
                raise InputError(f"{origin}: {_unsupported(model, dim, kind, tags[0])}")
            numbers.append(tags.astype(np.int64))
            rows = np.searchsorted(node_numbers, corners.astype(np.int64))
            nodes.append(rows.reshape(-1, dim + 1))
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
    return Simplices(np.concatenate(nodes), np.concatenate(numbers), np.concatenate(groups), names)


def _unsupported(model: Any, dim: int, kind: int, number: int) -> str:
    """Why elements of this kind are not read, and the way out if there is one."""
    shape, _, order, _, _, corners = model.mesh.getElementProperties(kind)
    text = (
        f"only first-order {_PLURAL[dim]} are supported, element {number} is a {shape} in Gmsh's "
        "words"
    )
    if order == 1 or corners != dim + 1:
        return text
    # A quadratic displacement has no affine strain there, so that a limit at points says nothing
    # about the rest of the cell.
    return (
        f"{text}, whose sides may be curved, so that the locking limit would hold at points only; "
        "call gmsh.model.mesh.setOrder(1) before the mesh is saved, and for quadratic "
        "displacements take discretisation.degree: 2, which needs no nodes on the edges"
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


def main(source: str, target: str, origin: str, what: str) -> int:
    """Read the mesh in ``source`` and save its arrays in ``target``; returns the exit code.

    ``origin`` names the mesh for messages, and ``what`` is the ``body``, or the ``triangles`` of a
    surface.  The message of an InputError is printed.
    """
    import gmsh

    try:
        with empty_model() as model:
            try:
                gmsh.merge(source)
            except Exception as error:  # Gmsh raises Exception itself
                said = str(error).replace(source, origin)
                raise InputError(f"Gmsh cannot read {origin}: {said}") from error
            if what == "triangles":
                np.savez(target, corners=triangles(model, origin))
            else:
                extract(model, origin).save(Path(target))
    except InputError as error:
        sys.stdout.buffer.write(str(error).encode("utf-8", errors="backslashreplace"))
        return error.exit_code
    return 0


if __name__ == "__main__":
    limit_process()
    sys.exit(main(*sys.argv[1:]))
