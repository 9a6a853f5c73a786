"""The meshes of builders and files, and refined ones: made on one rank, and distributed.

A distributed mesh becomes arrays on rank 0 in the order in which it was distributed, which does not
depend on the number of ranks; neither does what is made of these arrays.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import with_key
from contact_locking.findings import Finding
from contact_locking.mesh import abaqus
from contact_locking.mesh.checks import Touching, check_cells, checked
from contact_locking.mesh.data import MeshData, MeshElements, about
from contact_locking.mesh.distribution import of_cells, on_first_rank
from contact_locking.mesh.domain import Domain, distributed
from contact_locking.mesh.readers import extract, read_gmsh, read_xdmf
from contact_locking.meshes import build


def from_geometry(geometry: Any, comm: MPI.Intracomm, contact: Collection[str] = ()) -> Domain:
    """Generate a geometry of ``meshes`` with Gmsh on rank 0 and distribute it; collective.

    ``contact`` names the boundary parts that ``h_contact`` refines.
    """
    origin = type(geometry).__name__.lower()

    def make() -> MeshData:
        with build(geometry, contact=contact) as model:
            mesh = extract(model, origin)
        if not mesh.kind.is_simplex:
            check_cells(mesh)
        return mesh

    data = with_key("mesh.builder", lambda: on_first_rank(comm, make))
    return distributed(data, comm, origin, is_whole=geometry.bodies == 1)


def from_file(path: Path, comm: MPI.Intracomm, touching: Touching = ()) -> Domain:
    """Read a Gmsh file, a deck (.inp) or an XDMF file on rank 0, and distribute it; collective.

    ``touching`` are pairs of boundary parts that may touch each other without shared nodes.  Cells
    of second order are read by their corners, with a warning.
    Raises InputError if the file cannot be read, if the cells are not of one kind, and if the mesh
    is not a body.
    """
    read = {".xdmf": read_xdmf, ".inp": abaqus.read}.get(path.suffix.lower(), read_gmsh)

    def make() -> MeshData:
        data = read(path)
        with about(str(path)):
            return checked(data, touching)

    return with_key("mesh.file", lambda: distributed(on_first_rank(comm, make), comm, str(path)))


# What the mesh of a body knows beside its cells, as fields of `Domain`.
_FACTS = ("part_names", "unusable", "findings", "origin", "smoothing_radii")
_ARRAYS = [
    (kind, array) for kind in ("cells", "facets") for array in ("nodes", "numbers", "groups")
]


@dataclass(frozen=True)
class WholeMesh:
    """Points, cells and named facets, with what the mesh of a body knows beside them.

    ``parts`` (k,) gives for each cell the index of its connected part, and ``facts`` are other
    fields of `Domain`.
    """

    data: MeshData
    parts: IntArray
    facts: Mapping[str, Any]

    def save(self, path: Path) -> None:
        """Write a file that `load` reads, without Python's pickle."""
        data = self.data
        elements = {"cells": data.cells, "facets": data.facets}
        names = {kind: of_kind.names for kind, of_kind in elements.items()}
        facts = {**self.facts, "findings": [x.record for x in self.facts["findings"]]}
        words = json.dumps({"dim": data.dim, "names": names, "facts": facts}).encode()
        arrays = {f"{kind}.{array}": vars(elements[kind])[array] for kind, array in _ARRAYS}
        arrays |= {"points": data.points, "numbers": data.numbers, "parts": self.parts}
        np.savez(path, words=np.frombuffer(words, dtype=np.uint8), **arrays)

    @classmethod
    def load(cls, path: Path) -> WholeMesh:
        """The mesh in a file of `save`."""
        with np.load(path, allow_pickle=False) as file:
            words = json.loads(file["words"].tobytes())
            cells, facets = (
                MeshElements(
                    file[f"{kind}.nodes"],
                    file[f"{kind}.numbers"],
                    file[f"{kind}.groups"],
                    {name: tuple(tags) for name, tags in words["names"][kind].items()},
                )
                for kind in ("cells", "facets")
            )
            data = MeshData(words["dim"], file["points"], file["numbers"], cells, facets)
            records = words["facts"].pop("findings")
            findings = tuple(Finding(code, key, **numbers) for code, key, numbers in records)
            return cls(data, file["parts"], words["facts"] | {"findings": findings})


def gather_mesh(domain: Domain) -> WholeMesh | None:
    """The mesh on rank 0, None elsewhere; collective."""
    mesh, dim, comm = domain.mesh, domain.dim, domain.comm
    numbers = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
    owned = mesh.topology.index_map(dim).size_local
    cells = numbers[_compat.cell_corners(mesh)[:owned]]
    facets = domain.facet_tags.indices
    is_owned = facets < mesh.topology.index_map(dim - 1).size_local
    corners = numbers[_compat.entities_to_geometry(mesh, dim - 1, facets[is_owned])]

    def whole(local: Any) -> Any:
        parts = comm.gather(np.ascontiguousarray(local))
        return None if parts is None else np.concatenate(parts)

    place, coordinates = whole(numbers), whole(mesh.geometry.x[:, :dim])
    all_cells, groups, parts = (
        gather_cells(domain, values)
        for values in (cells, domain.cell_tags.values[:owned], domain.parts[:owned])
    )
    all_corners, marks = whole(corners), whole(domain.facet_tags.values[is_owned])
    if place is None or all_cells is None or groups is None or parts is None:
        return None
    points = np.empty((int(place.max()) + 1, dim))
    points[place] = coordinates
    order = np.lexsort(np.sort(all_corners, axis=1).T[::-1])
    named = elements(all_corners[order], marks[order], domain.facet_names)
    regions = {name: (tag,) for name, tag in domain.cell_names.items()}
    data = MeshData(
        dim, points, np.arange(len(points)), elements(all_cells, groups, regions), named
    )
    facts = {name: getattr(domain, name) for name in _FACTS}
    return WholeMesh(data, parts.astype(np.int64), facts)


def gather_cells(domain: Domain, values: Any) -> FloatArray | None:
    """Values (k, ...) of the owned cells of all ranks, on rank 0; None elsewhere; collective."""
    topology = domain.mesh.topology
    owned = topology.index_map(domain.dim).size_local
    order = np.asarray(topology.original_cell_index[:owned], dtype=np.int64)
    parts = domain.comm.gather((order, np.ascontiguousarray(values)))
    if parts is None:
        return None
    places = np.concatenate([place for place, _ in parts])
    return np.asarray(np.concatenate([local for _, local in parts])[np.argsort(places)])


def elements(nodes: Any, groups: Any, names: Mapping[str, tuple[int, ...]]) -> MeshElements:
    """Elements numbered from 1, as in a mesh file."""
    count: IntArray = np.arange(1, len(nodes) + 1)
    return MeshElements(
        np.asarray(nodes, dtype=np.int64), count, np.asarray(groups, dtype=np.int64), dict(names)
    )


def spread(mesh: WholeMesh | None, comm: MPI.Intracomm) -> Domain:
    """A refined mesh, distributed; only rank 0 has ``mesh``; collective."""

    def data() -> MeshData:
        assert mesh is not None
        return mesh.data

    first = on_first_rank(comm, data)
    domain = distributed(first, comm, "", is_whole=True)
    parts: IntArray = np.empty(0, dtype=np.int64) if mesh is None else mesh.parts
    facts = comm.bcast(mesh.facts if mesh else {})
    local = of_cells(domain.mesh, first.cells.nodes, parts).astype(np.int32)
    return replace(domain, parts=local, is_refined=True, **facts)
