"""The body's mesh with its named parts: read from Gmsh on one rank, distributed, checked.

Boundaries and regions are known by the names of Gmsh's physical groups, never by numbers.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.errors import InputError, with_key
from contact_locking.mesh_file.data import MeshData
from contact_locking.mesh_file.diagnosis import Diagnosis, diagnose
from contact_locking.mesh_file.gmsh_model import extract
from contact_locking.mesh_file.reader import read
from contact_locking.parallel import on_root
from contact_locking.problem.distribution import distribute

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Domain:
    """A simplicial mesh of the body with named boundary parts and regions.

    ``facet_tags`` holds exterior facets only, and every one of them that has a name.  ``parts``
    is, of each local cell, which of the ``part_names`` it belongs to: parts share no facets.
    ``unusable`` are other groups of facets, each with the reason.
    """

    mesh: dmesh.Mesh
    cell_tags: Any
    facet_tags: Any
    parts: IntArray
    cell_names: dict[str, int]
    facet_names: dict[str, int]
    part_names: tuple[str, ...] = ("the body",)
    unusable: dict[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    origin: str = field(default="the mesh")

    @property
    def comm(self) -> MPI.Intracomm:
        return self.mesh.comm

    @property
    def dim(self) -> int:
        return int(self.mesh.topology.dim)

    @cached_property
    def num_cells(self) -> int:
        return int(self.mesh.topology.index_map(self.dim).size_global)

    def facets(self, names: Iterable[str], key: str | None = None) -> IntArray:
        """Local exterior facets of the named boundary parts; collective.

        Raises InputError, with the names there are, for a name the mesh does not have.
        """
        parts = [self.facet_tags.find(self._tag(name, self.facet_names, key)) for name in names]
        return np.unique(np.concatenate(parts)) if parts else np.empty(0, dtype=np.int32)

    def cells(self, name: str, key: str | None = None) -> IntArray:
        """Local cells (owned and ghosts) of the named region."""
        return self.cell_tags.find(self._tag(name, self.cell_names, key))

    def ds(self, names: Iterable[str], key: str | None = None, **metadata: Any) -> ufl.Measure:
        """Surface measure over the named boundary parts; metadata goes to the form compiler."""
        tags = tuple(self._tag(name, self.facet_names, key) for name in names)
        measure = ufl.Measure("ds", domain=self.mesh, subdomain_data=self.facet_tags)
        return measure(tags, metadata=metadata)

    def owners(self, facets: IntArray) -> IntArray:
        """The local cell of each of the given exterior facets."""
        to_cell = self.mesh.topology.connectivity(self.dim - 1, self.dim)
        return to_cell.array[to_cell.offsets[facets]]

    def facet_diameter(self, facets: IntArray) -> float:
        """The largest edge among the given facets, over all ranks."""
        fdim = self.dim - 1
        self.mesh.topology.create_connectivity(fdim, self.dim)
        local = float(self.mesh.h(fdim, facets).max()) if len(facets) else 0.0
        return float(self.comm.allreduce(local, op=MPI.MAX))

    def bounding_box(self) -> FloatArray:
        """The least and greatest coordinates (2, d); collective."""
        x = self.mesh.geometry.x[:, : self.dim]
        low = self.comm.allgather(x.min(axis=0, initial=np.inf))
        high = self.comm.allgather(x.max(axis=0, initial=-np.inf))
        return np.array([np.min(low, axis=0), np.max(high, axis=0)])

    def extent(self) -> float:
        """``sqrt(12 lambda)``, lambda the largest second moment of the body per volume; collective.

        The length of a block, however it lies, where the bounding box is larger if it is turned.
        """
        dim, middle = self.dim, self.bounding_box().mean(axis=0)
        owned = self.mesh.topology.index_map(dim).size_local
        x = self.mesh.geometry.x[_compat.cell_nodes(self.mesh)[:owned], :dim] - middle
        volumes = np.abs(np.linalg.det(x[:, 1:] - x[:, :1]))
        sums = x.sum(axis=1)
        squares = np.einsum("cki,ckj->cij", x, x) + np.einsum("ci,cj->cij", sums, sums)
        volume = self.comm.allreduce(volumes.sum())
        centre = self.comm.allreduce(volumes @ sums) / ((dim + 1) * volume)
        second = self.comm.allreduce(np.tensordot(volumes, squares, axes=1))
        moments = second / ((dim + 1) * (dim + 2) * volume) - np.outer(centre, centre)
        return float(np.sqrt(12.0 * np.linalg.eigvalsh(moments)[-1]))

    def _tag(self, name: str, table: dict[str, int], key: str | None) -> int:
        if name not in table and table is self.facet_names and name in self.unusable:
            raise InputError(f"in {self.origin}, {self.unusable[name]}", key)
        if name not in table:
            what = "boundary part" if table is self.facet_names else "region"
            there = ", ".join(sorted(table)) or "none at all"
            near = difflib.get_close_matches(name, table, n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise InputError(
                f"no {what} named {name!r} in {self.origin}; it has: {there}.{hint}", key
            )
        return table[name]


def from_geometry(geometry: Any, comm: MPI.Intracomm) -> Domain:
    """Generate a geometry of ``meshes`` with Gmsh on rank 0 and distribute it; collective."""
    origin = type(geometry).__name__.lower()

    def make() -> tuple[MeshData, Diagnosis]:
        from contact_locking.meshes import build

        with build(geometry) as model:
            mesh = extract(model, origin)
        return mesh, Diagnosis.of_sound(mesh)

    return with_key("mesh.builder", lambda: _distributed(make, comm, origin))


def from_file(path: Path, comm: MPI.Intracomm) -> Domain:
    """Read a Gmsh file with named physical groups on rank 0 and distribute it; collective.

    Raises InputError if it cannot be read, is not made of first-order triangles or tetrahedra,
    or is no body, as `mesh_file.diagnosis` says.
    """

    def make() -> tuple[MeshData, Diagnosis]:
        mesh = read(path)
        return mesh, diagnose(mesh, str(path))

    return with_key("mesh.file", lambda: _distributed(make, comm, str(path)))


def _distributed(
    make: Callable[[], tuple[MeshData, Diagnosis]], comm: MPI.Intracomm, origin: str
) -> Domain:
    held: list[tuple[MeshData, Diagnosis]] = []

    def prepare() -> tuple[int, dict[str, Any]]:
        mesh, found = make()
        held.append((mesh, found))
        facts = {
            "cell_names": mesh.cells.names,
            "facet_names": found.facets.names,
            "unusable": found.unusable,
            "warnings": tuple(found.warnings),
            "part_names": found.part_names,
        }
        return mesh.dim, facts

    dim, facts = on_root(comm, prepare)
    if held:
        mesh, found = held[0]
        made = distribute(comm, dim, mesh, found.facets, found.parts)
    else:
        made = distribute(comm, dim, None, None, np.empty(0, dtype=np.int64))
    return Domain(made.mesh, made.cell_tags, made.facet_tags, made.parts, origin=origin, **facts)
