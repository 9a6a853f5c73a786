"""The mesh of the body with named parts: checked and distributed.

Boundary parts and regions have the names of Gmsh's physical groups; parts of the boundary may
overlap.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.arrays import AXES, BoolArray, FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.findings import Finding
from contact_locking.laws.body import REVOLUTION, STRAIGHT, Kinematics
from contact_locking.mesh.data import NAMED, CellKind, MeshData, mean_normals, point_words
from contact_locking.mesh.distribution import Regions, connected_parts, distribute
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.plain_text import nearest


def tags_of(
    mesh: dmesh.Mesh, marks: Mapping[str, BoolArray]
) -> tuple[dmesh.MeshTags, dict[str, tuple[int, ...]]]:
    """Tags of facets, and for each name of ``marks`` the values of its facets; collective.

    Facets that several names share have a value of their own.
    """
    facets_of_rank = mesh.topology.index_map(mesh.topology.dim - 1)
    count = facets_of_rank.size_local + facets_of_rank.num_ghosts
    every = np.array(list(marks.values())).reshape(len(marks), count)
    facets = np.flatnonzero(every.any(axis=0)).astype(np.int32)
    local, place = np.unique(every[:, facets].T, axis=0, return_inverse=True)
    kinds: BoolArray = np.unique(np.concatenate(mesh.comm.allgather(local)), axis=0)[::-1]
    values = 1 + np.nonzero((local[:, None] == kinds).all(axis=2))[1].astype(np.int32)
    of_name = {
        name: tuple(1 + int(place) for place in np.flatnonzero(kinds[:, column]))
        for column, name in enumerate(marks)
    }
    tags = dmesh.meshtags(mesh, mesh.topology.dim - 1, facets, values[place.reshape(-1)])
    return tags, of_name


# A coordinate below this share of the largest is rounding.
_ROUNDING = 1e-9


#: Names of boundary parts, local indices of facets (k,), or mesh tags with one of their values.
Where = Any


@dataclass(frozen=True)
class Domain:
    """A mesh of the body, with cells of one kind, and named boundary parts and regions.

    ``facet_tags`` holds the exterior facets that have a name, and ``facet_names`` the values of the
    facets of each name; facets may have several names.  ``parts`` gives for each local cell
    the index of its connected part in ``part_names``; cells of two parts share no facet.
    ``unusable`` gives, for the name of every other group of facets, why the group bounds nothing.
    ``is_refined`` tells a mesh that was made by the refinement of the mesh of a study, and
    ``smoothing_radii`` then gives, for the key of a contact, the default radius of R on that mesh.
    ``axisymmetric`` says that the mesh is the half section of a body of revolution about x = 0.
    """

    mesh: dmesh.Mesh
    cell_tags: Any
    facet_tags: Any
    parts: IndexArray
    cell_names: dict[str, int]
    facet_names: dict[str, tuple[int, ...]]
    part_names: tuple[str, ...] = ("the body",)
    unusable: dict[str, str] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    origin: str = field(default="the mesh")
    is_refined: bool = False
    smoothing_radii: dict[str, float] = field(default_factory=dict)
    axisymmetric: bool = False

    @property
    def comm(self) -> MPI.Intracomm:
        return self.mesh.comm

    @property
    def dim(self) -> int:
        return int(self.mesh.topology.dim)

    @property
    def kind(self) -> CellKind:
        return NAMED[self.mesh.topology.cell_name()]

    @property
    def kinematics(self) -> Kinematics:
        return REVOLUTION if self.axisymmetric else STRAIGHT

    @cached_property
    def num_cells(self) -> int:
        return int(self.mesh.topology.index_map(self.dim).size_global)

    def facets(self, names: Iterable[str], key: str | None = None) -> IndexArray:
        """Local exterior facets of the named boundary parts; collective.

        Raises InputError, with the names of the mesh, for a name that the mesh does not have.
        """
        parts = [self.facet_tags.find(tag) for tag in self._facet_tags(names, key)]
        return np.unique(np.concatenate(parts)) if parts else np.empty(0, dtype=np.int32)

    def cells(self, name: str, key: str | None = None) -> IndexArray:
        """Local cells (owned and ghosts) of the named region."""
        if name not in self.cell_names:
            raise self._unknown("region", name, self.cell_names, key)
        return self.cell_tags.find(self.cell_names[name])

    def ds(self, names: Iterable[str], key: str | None = None, **metadata: Any) -> ufl.Measure:
        """The surface measure of the named boundary parts; the form compiler takes ``metadata``."""
        return self.kinematics.weighted(self.plain_ds(names, key, **metadata))

    def plain_ds(
        self, names: Iterable[str], key: str | None = None, **metadata: Any
    ) -> ufl.Measure:
        """The measure of the named boundary parts as parts of the mesh, without ``2 pi r``."""
        tags = self._facet_tags(names, key)
        measure = ufl.Measure("ds", domain=self.mesh, subdomain_data=self.facet_tags)
        return measure(tags, metadata=metadata)

    def dx(self, **metadata: Any) -> ufl.Measure:
        """The measure of the body; the form compiler takes ``metadata``."""
        return self.kinematics.weighted(ufl.Measure("dx", domain=self.mesh, metadata=metadata))

    def owners(self, facets: IndexArray) -> IndexArray:
        """The local cells (k,) of exterior facets (k,)."""
        to_cell = self.mesh.topology.connectivity(self.dim - 1, self.dim)
        return to_cell.array[to_cell.offsets[facets]]

    def area_normals(self, facets: IndexArray) -> tuple[FloatArray, FloatArray]:
        """``int nu`` (k, d) with the outward normal nu, and ``int 1`` (k,) of local facets (k,)."""
        x = self.mesh.geometry.x[:, : self.dim]
        corners = x[_compat.entities_to_geometry(self.mesh, self.dim - 1, facets)]
        normals, areas = mean_normals(self.kind.facet, corners)
        cells = _compat.cell_corners(self.mesh)[self.owners(facets)]
        inward = x[cells].mean(axis=1) - corners.mean(axis=1)
        normals *= -np.sign(np.einsum("ki,ki->k", normals, inward))[:, None]
        return normals, areas

    def facet_diameter(self, facets: IndexArray) -> float:
        """The longest edge among the given facets of all ranks; collective."""
        fdim = self.dim - 1
        self.mesh.topology.create_connectivity(fdim, self.dim)
        return maximum(self.comm, self.mesh.h(fdim, facets) if len(facets) else 0.0)

    @cached_property
    def bounding_box(self) -> FloatArray:
        """The least and greatest coordinates (2, d); the first use is collective."""
        return box(self.comm, self.mesh.geometry.x[:, : self.dim])

    @cached_property
    def extent(self) -> float:
        """``sqrt(12 lambda)``, lambda the largest second moment of the body per volume.

        The extent of a slender body is its length.  A rotation of the body changes the bounding box
        and does not change the extent.  The first use is collective.
        """
        dim, middle = self.dim, self.bounding_box.mean(axis=0)
        owned = self.mesh.topology.index_map(dim).size_local
        simplices = self.kind.split(_compat.cell_corners(self.mesh)[:owned])
        x = self.mesh.geometry.x[simplices, :dim] - middle
        volumes = np.abs(np.linalg.det(x[:, 1:] - x[:, :1]))
        sums = x.sum(axis=1)
        squares = np.einsum("cki,ckj->cij", x, x) + np.einsum("ci,cj->cij", sums, sums)
        volume = self.comm.allreduce(volumes.sum())
        centre = self.comm.allreduce(volumes @ sums) / ((dim + 1) * volume)
        second = self.comm.allreduce(np.tensordot(volumes, squares, axes=1))
        moments = second / ((dim + 1) * (dim + 2) * volume) - np.outer(centre, centre)
        return float(np.sqrt(12.0 * np.linalg.eigvalsh(moments)[-1]))

    def compact_size(self, unknowns: int, degree: int) -> int:
        """The unknowns of a cube that takes as long to factorise as this body; collective.

        A factorisation depends on the separators of the mesh: n^2 nodes in a cube with n along each
        edge, and t m in a plate of m by m by t.  The plate is the one with as many cells and as
        many facets outside as the body.  A body in 2D counts as it is.
        """
        if self.dim == 2:
            return unknowns
        facets = self.mesh.topology.index_map(self.dim - 1)
        boundary = dmesh.exterior_facet_indices(self.mesh.topology)
        outside = self.comm.allreduce(int(np.sum(boundary < facets.size_local)))
        # A box of tetrahedra is divided into six, and its sides into two triangles each.
        boxes, squares = (6, 2) if self.kind.is_simplex else (1, 1)
        width, thickness = _plate(self.num_cells / boxes, outside / squares)
        separator = (degree * width + 1.0) * (degree * thickness + 1.0)
        return min(unknowns, round(self.dim * separator**1.5))

    def where(self, point: FloatArray) -> str:
        """A point (d,) in words, ``x = 1, y = 2``; coordinates that are rounding are 0."""
        rounding = _ROUNDING * np.abs(self.mesh.geometry.x).max(initial=0.0)
        shown = np.where(np.abs(point) <= rounding, 0.0, point)
        return ", ".join(f"{axis} = {x:.6g}" for axis, x in zip(AXES, shown, strict=False))

    def require_names(self, names: Iterable[str], known: Iterable[str], key: str | None) -> None:
        """Raise InputError for a name that is not one of the known boundary parts."""
        for name in names:
            if name not in known and name in self.unusable:
                raise InputError(f"in {self.origin}, {self.unusable[name]}", key)
            if name not in known:
                raise self._unknown("boundary part", name, known, key)

    def _facet_tags(self, names: Iterable[str], key: str | None) -> tuple[int, ...]:
        names = tuple(names)
        self.require_names(names, self.facet_names, key)
        return tuple(sorted({tag for name in names for tag in self.facet_names[name]}))

    def _unknown(self, kind: str, name: str, known: Iterable[str], key: str | None) -> InputError:
        listed = ", ".join(sorted(known)) or "none at all"
        return InputError(
            f"no {kind} named {name!r} in {self.origin}{nearest(name, known)}; it has: {listed}",
            key,
        )


def _plate(boxes: float, squares: float) -> tuple[float, float]:
    """Width m and thickness t <= m with ``m^2 t = boxes`` and ``2 m^2 + 4 m t = squares``.

    m is the largest root of ``m^3 - (squares/2) m + 2 boxes``.  Where there is none, as for a ball,
    m is that of the cube with so many squares.
    """
    cube = math.sqrt(squares / 6.0)
    width = 2.0 * cube * math.cos(math.acos(-min(boxes / cube**3, 1.0)) / 3.0)
    return width, boxes / width**2


def assembled(
    mesh: dmesh.Mesh,
    regions: Regions,
    facets: Mapping[str, BoolArray],
    parts: tuple[IndexArray, int],
    **fields: Any,
) -> Domain:
    """The domain of a mesh with marks of facets by name; ``fields`` are fields of `Domain`.

    ``parts`` are the connected parts of the local cells and their number.  Collective.
    """
    numbers, bodies = parts
    every = np.arange(len(regions.numbers), dtype=np.int32)
    tags, names = tags_of(mesh, facets)
    return Domain(
        mesh,
        dmesh.meshtags(mesh, mesh.topology.dim, every, regions.numbers),
        tags,
        numbers,
        regions.names,
        names,
        part_names(mesh, numbers, bodies, regions.numbers, regions.names),
        **fields,
    )


def distributed(data: MeshData, comm: MPI.Intracomm, origin: str, is_whole: bool = False) -> Domain:
    """The domain of a mesh that rank 0 has, ``is_whole`` for one of a single part; collective."""
    made = distribute(comm, data)
    # SciPy, which finds the parts, would take a tenth of the time of `check`.
    whole = np.zeros(len(made.regions.numbers), dtype=np.int32), 1
    parts = whole if is_whole else connected_parts(made.mesh)
    words = {"unusable": dict(data.unusable), "findings": data.findings}
    return assembled(made.mesh, made.regions, made.facets, parts, origin=origin, **words)


def part_names(
    mesh: dmesh.Mesh, parts: IndexArray, count: int, regions: IndexArray, names: Mapping[str, int]
) -> tuple[str, ...]:
    """The name of each part, from its regions and its extreme coordinates; collective.

    ``parts`` (k,) and ``regions`` (k,) are the numbers of the local cells, and ``names`` gives the
    numbers of regions.
    """
    if count == 1:
        return ("the body",)
    words_of_all = []
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    corners = _compat.cell_corners(mesh)[:owned]
    for body in range(count):
        inside = parts[:owned] == body
        mine = set(np.unique(regions[:owned][inside]).tolist())
        every = set().union(*mesh.comm.allgather(mine))
        of_part = [name for name, number in names.items() if number in every]
        x = mesh.geometry.x[corners[inside], : mesh.topology.dim].reshape(-1, mesh.topology.dim)
        low, high = (point_words(corner) for corner in box(mesh.comm, x))
        words = ", ".join([*of_part, f"from {low} to {high}"])
        words_of_all.append(f"part {body + 1} of the body ({words})")
    return tuple(words_of_all)


def box(comm: MPI.Intracomm, points: FloatArray) -> FloatArray:
    """The least and the greatest coordinates (2, d) of the points of all ranks; collective."""
    low = comm.allgather(points.min(axis=0, initial=np.inf))
    high = comm.allgather(points.max(axis=0, initial=-np.inf))
    return np.array([np.min(low, axis=0), np.max(high, axis=0)])


# A node with a smaller radius than this share of the largest radius lies on the axis.
_ON_AXIS = 1e-9


def half_section(domain: Domain, key: str = "mesh.axisymmetric") -> Domain:
    """The domain as the half section of a body of revolution about x = 0; collective.

    Coordinates x that are zero except for rounding become zero.  Raises InputError for a mesh in
    three dimensions, and for a mesh that crosses the axis; ``key`` is what asks for the section.
    """
    if domain.dim != 2:
        raise InputError(
            "needs a mesh in two dimensions, the half section of the body in the coordinates "
            "(r, z) = (x, y)",
            key,
        )
    low, high = domain.bounding_box
    radius = domain.mesh.geometry.x[:, 0]
    if low[0] < -_ON_AXIS * high[0]:
        hint = "; take its half with quarter: true" if domain.origin in ("disc", "annulus") else ""
        raise InputError(
            f"the half section must lie in x >= 0, where x is the radius r, and {domain.origin} "
            f"reaches x = {low[0]:.6g}{hint}",
            key,
        )
    radius[np.abs(radius) <= _ON_AXIS * high[0]] = 0.0
    return replace(domain, axisymmetric=True)


def is_on_axis(domain: Domain, x: FloatArray) -> BoolArray:
    """Which of the points x (d, k) lie on the axis, (k,); collective."""
    return np.asarray(np.abs(x[0]) <= _ON_AXIS * domain.bounding_box[1, 0])


def axis_dofs(domain: Domain, space: fem.FunctionSpace) -> IndexArray:
    """The local dofs of u_r on the axis; collective."""
    on_axis = is_on_axis(domain, space.tabulate_dof_coordinates().T)
    return np.flatnonzero(on_axis).astype(np.int32) * np.int32(domain.dim)


def require_surface(domain: Domain, names: tuple[str, ...], key: str) -> None:
    """Raise InputError for boundary parts on the axis, which are no surface; collective."""
    if not domain.axisymmetric:
        return
    for name in names:
        facets = domain.facets((name,), key)
        if not domain.comm.allreduce(len(facets)):
            continue
        nodes = _compat.entities_to_geometry(domain.mesh, 1, facets)
        if not on_any_rank(domain.comm, domain.mesh.geometry.x[nodes, 0] > 0.0):
            raise InputError(f"{name!r} lies on the axis of revolution and is no surface", key)
