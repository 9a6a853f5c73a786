"""The body's mesh with its named parts: read from Gmsh on one rank, distributed, checked.

Boundaries and regions are known by the names of Gmsh's physical groups, never by numbers.
"""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.errors import ContactLockingError, InputError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]
T = TypeVar("T")

# Gmsh's element numbers of the first-order simplices.
_SIMPLEX = {2: 2, 3: 4}


@dataclass(frozen=True)
class Domain:
    """A simplicial mesh of the body with named boundary parts and regions.

    ``facet_tags`` holds exterior facets only, and every one of them that has a name.
    """

    mesh: dmesh.Mesh
    cell_tags: Any
    facet_tags: Any
    cell_names: dict[str, int]
    facet_names: dict[str, int]
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

    def _tag(self, name: str, table: dict[str, int], key: str | None) -> int:
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

    def source() -> AbstractContextManager[Any]:
        from contact_locking import meshes

        return meshes.build(geometry)

    return _from_gmsh(source, comm, type(geometry).__name__.lower(), "mesh.builder")


def from_file(path: Path, comm: MPI.Intracomm) -> Domain:
    """Read a Gmsh file with named physical groups on rank 0 and distribute it; collective.

    Raises InputError if it cannot be read, is not made of first-order triangles or tetrahedra,
    or lacks physical groups.
    """

    @contextlib.contextmanager
    def source() -> Iterator[Any]:
        import gmsh

        from contact_locking import meshes

        if not path.is_file():
            raise InputError(f"there is no mesh file {path}", "mesh.file")
        with meshes.empty_model() as model:
            try:
                gmsh.merge(str(path))
            except Exception as error:  # Gmsh's own errors have no type of their own
                raise InputError(f"Gmsh cannot read {path}: {error}", "mesh.file") from error
            yield model

    return _from_gmsh(source, comm, str(path), "mesh.file")


def _from_gmsh(
    source: Callable[[], AbstractContextManager[Any]], comm: MPI.Intracomm, origin: str, key: str
) -> Domain:
    with contextlib.ExitStack() as stack:

        def prepare() -> tuple[int, dict[str, int], dict[str, int]]:
            held.append(stack.enter_context(source()))
            return _check_model(held[0], origin, key)

        held: list[Any] = []
        dim, cell_names, facet_names = on_root(comm, prepare)
        model = held[0] if held else None
        mesh, cell_tags, facet_tags = _compat.model_to_mesh(model, comm, 0, dim)
    fdim = dim - 1
    mesh.topology.create_connectivity(fdim, dim)
    mesh.topology.create_connectivity(dim, fdim)
    exterior = np.isin(facet_tags.indices, dmesh.exterior_facet_indices(mesh.topology))
    facet_tags = dmesh.meshtags(
        mesh, fdim, facet_tags.indices[exterior], facet_tags.values[exterior]
    )
    for name, tag in list(facet_names.items()):
        if comm.allreduce(len(facet_tags.find(tag))) == 0:
            del facet_names[name]
    return Domain(mesh, cell_tags, facet_tags, cell_names, facet_names, origin)


def _check_model(model: Any, origin: str, key: str) -> tuple[int, dict[str, int], dict[str, int]]:
    """Dimension and names of a meshed model, or an InputError that says why it will not do."""
    dim = max((d for d, _ in model.getEntities()), default=0)
    if dim < 2:
        raise InputError(f"{origin} is a {dim}D mesh; a body in 2D or 3D is needed", key)
    types = {int(t) for t in model.mesh.getElementTypes(dim)}
    if not types:
        raise InputError(f"{origin} holds no cells of dimension {dim}; generate the mesh", key)
    if types != {_SIMPLEX[dim]}:
        shape = "triangles" if dim == 2 else "tetrahedra"
        raise InputError(f"{origin}: only first-order {shape} are supported", key)
    if dim == 2:
        coordinates = model.mesh.getNodes()[1]
        if np.any(np.abs(coordinates[2::3]) > 1e-12 * np.abs(coordinates).max()):
            raise InputError(f"{origin} is a surface in space; a 2D body lies in z = 0", key)
    cells, facets = (_group_names(model, d, origin, key) for d in (dim, dim - 1))
    if not cells:
        raise InputError(f"{origin} has no physical group of cells; name the body's regions", key)
    covered = {int(e) for t in cells.values() for e in model.getEntitiesForPhysicalGroup(dim, t)}
    if covered != {int(tag) for _, tag in model.getEntities(dim)}:
        raise InputError(f"{origin} has cells outside every physical group; name them all", key)
    return dim, cells, facets


def _group_names(model: Any, dim: int, origin: str, key: str) -> dict[str, int]:
    names: dict[str, int] = {}
    owner: dict[int, str] = {}
    for _, tag in model.getPhysicalGroups(dim):
        name = model.getPhysicalName(dim, tag) or str(tag)
        names[name] = int(tag)
        for entity in model.getEntitiesForPhysicalGroup(dim, tag):
            if int(entity) in owner:
                raise InputError(
                    f"{origin}: physical groups {owner[int(entity)]!r} and {name!r} share an "
                    "entity; let each part of the mesh have one name",
                    key,
                )
            owner[int(entity)] = name
    return names


def on_root(comm: MPI.Intracomm, work: Callable[[], T]) -> T:
    """Run ``work`` on rank 0 and give its result to all, or raise its error on all; collective."""
    outcome: tuple[T | None, Exception | None] = (None, None)
    if comm.rank == 0:
        try:
            outcome = (work(), None)
        except ContactLockingError as error:
            outcome = (None, error)
        except (ValueError, RuntimeError) as error:
            outcome = (None, InputError(str(error)))
        except OSError as error:
            outcome = (None, InputError(f"{error.filename}: {error.strerror or error}"))
    result, failure = comm.bcast(outcome, root=0)
    if failure is not None:
        raise failure
    return result


def agree(comm: MPI.Intracomm, work: Callable[[], T]) -> T:
    """Run ``work`` on every rank, and raise on all what it raised on any; collective.

    For local evaluations of user data: an error on one rank alone would leave the others waiting.
    """
    failure: ContactLockingError | None = None
    try:
        result = work()
    except ContactLockingError as error:
        failure = error
    for raised in comm.allgather(failure):
        if raised is not None:
            raise raised
    return result
