"""Named parts of the boundary: of a script's mesh, by place, skins, and a table of all groups."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.arrays import BoolArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.mesh.data import NAMED, components, measures
from contact_locking.mesh.distribution import Regions, connected_parts, marked_facets
from contact_locking.mesh.domain import Domain, Where, assembled, is_on_axis, tags_of
from contact_locking.parallel import agree, on_any_rank
from contact_locking.plain_text import nearest


class NamedFacets:
    """Boundary parts by names: those of ``names``, which are values of ``tags``, and given facets.

    Every place of a problem is told by :meth:`add` before :meth:`domain` makes the domain.
    """

    def __init__(
        self,
        mesh: dmesh.Mesh,
        tags: dmesh.MeshTags | None = None,
        names: Mapping[str, int] | None = None,
    ) -> None:
        if mesh.topology.cell_name() not in NAMED:
            known = ", ".join(kind.plural for kind in NAMED.values())
            raise InputError(f"must have cells of one kind of these: {known}", "mesh")
        if mesh.geometry.dim != mesh.topology.dim:
            raise InputError("must have cells that fill the space around them", "mesh")
        if _compat.coordinate_map(mesh).degree > 1:
            raise InputError(
                "must have cells with straight sides; make the mesh of first order "
                "(gmsh.model.mesh.setOrder(1))",
                "mesh",
            )
        self._mesh, self._tags, self._names = mesh, tags, dict(names or {})
        dim = mesh.topology.dim
        mesh.topology.create_entities(dim - 1)
        mesh.topology.create_connectivity(dim - 1, dim)
        mesh.topology.create_connectivity(dim, dim - 1)
        self._places: dict[str, BoolArray] = {}
        if self._names and tags is None:
            raise InputError("needs the mesh tags whose values have the names", "tags")
        self._outside = marked_facets(mesh, np.asarray(dmesh.exterior_facet_indices(mesh.topology)))

    def add(self, where: Where, key: str) -> tuple[str, ...]:
        """Add a place, and return its names; collective.

        Raises InputError with the key for a name that is not there, and for facets that are not on
        the boundary.
        """
        mesh, comm = self._mesh, self._mesh.comm
        if isinstance(where, str):
            where = (where,)
        if callable(where):
            raise InputError(
                "must be names, facets or (mesh tags, value), and no function: "
                "dolfinx.mesh.locate_entities_boundary finds facets by a function",
                key,
            )
        if not hasattr(where, "__len__"):
            kind = type(where).__name__
            raise InputError(f"must be names, facets or (mesh tags, value), not {kind}", key)
        places: dict[str, npt.NDArray[Any]] = {}
        if len(where) and all(isinstance(name, str) for name in where):
            for name in where:
                if name not in self._names:
                    known = ", ".join(sorted(self._names)) or "none at all"
                    hint = nearest(name, self._names)
                    message = f"no boundary part is named {name!r}{hint}; names has: {known}"
                    raise InputError(message, key)
                assert self._tags is not None
                places[name] = np.asarray(self._tags.find(self._names[name]))
        elif len(where) == 2 and isinstance(where[0], dmesh.MeshTags):
            places[key] = np.asarray(where[0].find(where[1]))
        else:
            places[key] = np.asarray(where)
        count = len(self._outside)
        for name, facets in places.items():

            def checked(facets: npt.NDArray[Any] = facets) -> IndexArray:
                if len(facets) and facets.dtype.kind not in "iu":
                    hint = "; np.flatnonzero gives those of marks" if facets.dtype == bool else ""
                    raise InputError(f"must be the local numbers of facets{hint}", key)
                if np.any((facets < 0) | (facets >= count)):
                    message = f"has numbers that are no facets of the mesh, which has {count}"
                    raise InputError(message, key)
                return facets.astype(np.int32)

            marks = marked_facets(mesh, agree(comm, checked))
            if not on_any_rank(comm, marks):
                message = "has no facet"
                if name in self._names:
                    message = f"no facet has the tag {self._names[name]} of {name!r}"
                raise InputError(message, key)
            if on_any_rank(comm, marks & ~self._outside):
                raise InputError("has facets that are not on the boundary of the mesh", key)
            self._places[name] = marks
        return tuple(places)

    def domain(self) -> Domain:
        """The domain with these boundary parts; collective."""
        parts = connected_parts(self._mesh)
        none = Regions(np.zeros_like(parts[0]), {})
        return assembled(self._mesh, none, self._places, parts)


# A skin encloses a body if the body is thicker than this share of its length.
_THIN = 1e-9


def facets_of_skins(domain: Domain, kind: str) -> IndexArray:
    """The owned facets of the inner or of the outer skins of the bodies; collective.

    Skins are parts of the boundary whose facets are joined, by edges in 3D.  Inner ones enclose no
    body, ``int x . nu <= 0``, as those of a cavity or a crack.  A cavity that a plane of symmetry
    cuts is a part of the outer skin; one on the axis of a body of revolution is a skin, as the axis
    is no boundary.
    """
    mesh, comm, dim = domain.mesh, domain.comm, domain.dim
    for other in (dim - 2, dim):
        mesh.topology.create_connectivity(dim - 1, other)
    facets = np.asarray(dmesh.exterior_facet_indices(mesh.topology), dtype=np.int32)
    facets = facets[facets < mesh.topology.index_map(dim - 1).size_local]
    nodes = mesh.geometry.x[_compat.entities_to_geometry(mesh, dim - 1, facets), :dim]
    if domain.axisymmetric:
        on_axis = is_on_axis(domain, nodes.reshape(-1, dim).T)
        kept = ~on_axis.reshape(nodes.shape[:2]).all(axis=1)
        facets, nodes = facets[kept], nodes[kept]
    ends = mesh.topology.connectivity(dim - 1, dim - 2).array
    ends = ends.reshape(-1, 2 if dim == 2 else domain.kind.facet.corners)[facets]
    ridges = mesh.topology.index_map(dim - 2).local_to_global(ends.reshape(-1))
    ridges = np.concatenate(comm.allgather(ridges.reshape(ends.shape)))
    # Facets and ridges are the nodes of a graph, joined where a facet has a ridge.
    names, rows = np.unique(ridges, return_inverse=True)
    joins = np.repeat(np.arange(len(ridges)), ridges.shape[1]), len(ridges) + rows.reshape(-1)
    numbers = components(np.column_stack(joins), len(ridges) + len(names))[1][: len(ridges)]
    local = numbers[sum(comm.allgather(len(facets))[: comm.rank]) :][: len(facets)]
    normals, areas = domain.area_normals(facets)
    # A skin is closed, or ends on the axis, where x = 0: the origin changes nothing.
    middle = domain.bounding_box.mean(axis=0)
    middle[0] *= not domain.axisymmetric
    heights = np.sum((nodes.mean(axis=1) - middle) * normals, axis=1)
    count = int(numbers.max(initial=-1)) + 1
    inside, size = (
        comm.allreduce(np.bincount(local, values, count)) for values in (heights, areas)
    )
    is_inner = inside <= _THIN * domain.extent * size
    return facets[is_inner[local] == (kind == "inner")]


# A point is on a plane, or in a box, up to this share of the size of the body.
_ON_PLANE = 1e-6
# The points of a facet are its centre and its corners, which are pulled towards the centre by this
# share: a facet up to x = 1 is in x < 1.
_PULLED = 1e-6
# A facet faces a direction if the cosine between its normal and the direction is above this.
_ALONG = 1e-6
_NO_SKIN = (
    "; a cavity that is open, or that a plane of symmetry cuts, belongs to the outer skin: name it "
    "by a box, a plane or the direction that it is facing"
)


def with_parts(domain: Domain, places: Mapping[str, Any], key: str) -> Domain:
    """The domain with more boundary parts, each of which may name those before it; collective.

    A place ``holds`` points (d, k), the corners and the centre of its facets, up to a rounding.  It
    may be ``on`` named parts, have a vector ``facing`` along which the mean outward normals have a
    positive component, and be on the inner or outer ``skin`` of a body.
    Raises InputError, with the name behind ``key``, for a part without facets and for a name that
    the mesh has already.
    """
    mesh, dim = domain.mesh, domain.dim
    marks = {name: marked_facets(mesh, domain.facets((name,))) for name in domain.facet_names}
    mesh.topology.create_connectivity(dim - 1, dim)
    outside = marked_facets(mesh, np.asarray(dmesh.exterior_facet_indices(mesh.topology)))
    every = np.flatnonzero(outside).astype(np.int32)
    corners = mesh.geometry.x[_compat.entities_to_geometry(mesh, dim - 1, every), :dim]
    centres = corners.mean(axis=1, keepdims=True)
    points = np.concatenate([corners + _PULLED * (centres - corners), centres], axis=1)
    rounding = _ON_PLANE * float(np.ptp(domain.bounding_box, axis=0).max())
    for name, place in places.items():
        at = f"{key}.{name}"
        if name in marks:
            raise InputError(f"{domain.origin} has a boundary part with this name already", at)
        held = place.holds(points.reshape(-1, dim).T, rounding)
        inside = held.reshape(points.shape[:2]).all(axis=1)
        if place.facing is not None:
            normals, areas = domain.area_normals(every)
            inside &= normals @ place.facing > _ALONG * np.linalg.norm(place.facing) * areas
        if place.skin is not None:
            inside &= marked_facets(mesh, facets_of_skins(domain, place.skin))[every]
        marks[name] = np.zeros_like(outside)
        marks[name][every] = inside
        if place.on:
            domain.require_names(place.on, marks, f"{at}.on")
            marks[name] &= np.any([marks[other] for other in place.on], axis=0)
        if not on_any_rank(mesh.comm, bool(marks[name].any())):
            low, high = (domain.where(end) for end in domain.bounding_box)
            skin = "" if place.skin is None else _NO_SKIN
            raise InputError(
                f"catches no facet of the boundary, which is between {low} and {high}{skin}", at
            )
    tags, names = tags_of(mesh, marks)
    return dataclasses.replace(domain, facet_tags=tags, facet_names=names)


# A boundary part is plane if the mean normal is longer, and closed if the mean normal is shorter.
_FLAT, _CLOSED = 1.0 - 1e-6, 1e-2


@dataclass(frozen=True)
class Group:
    """A group: the number of its cells or facets, their measure, and the mean outward normal.

    The mean normal ``int nu / int 1`` of a boundary part is a unit vector for a plane part, shorter
    for a curved part, and zero for a closed part.  A region has none.
    """

    name: str
    dim: int
    count: int
    measure: float
    normal: tuple[float, ...] | None = None

    def facing(self) -> str:
        """The mean normal in words; empty for a region."""
        if self.normal is None:
            return ""
        length = float(np.linalg.norm(self.normal))
        if length < _CLOSED:
            return "all ways (closed)"
        shown = ", ".join(f"{x:.3g}" for x in np.round(self.normal, 9) + 0.0)
        return f"({shown}){'' if length > _FLAT else ' (curved)'}"


def groups(domain: Domain) -> list[Group]:
    """The regions, then the boundary parts, sorted by name; collective."""
    comm, topology, dim = domain.comm, domain.mesh.topology, domain.dim
    rows = []
    for name in sorted(domain.cell_names):
        cells = domain.cells(name)
        cells = cells[cells < topology.index_map(dim).size_local]
        corners = domain.mesh.geometry.x[_compat.cell_corners(domain.mesh)[cells], :dim]
        local = len(cells), float(measures(domain.kind, corners).sum())
        count, measure = (comm.allreduce(x) for x in local)
        rows.append(Group(name, dim, count, measure))
    for name in sorted(domain.facet_names):
        facets = domain.facets((name,))
        facets = facets[facets < topology.index_map(dim - 1).size_local]
        normals, areas = domain.area_normals(facets)
        count, measure, total = (
            comm.allreduce(x) for x in (len(facets), float(areas.sum()), normals.sum(axis=0))
        )
        normal = tuple(float(x) for x in total / measure)
        rows.append(Group(name, dim - 1, count, measure, normal))
    return rows


def group_table(rows: list[Group]) -> list[tuple[str, str, str, str, str]]:
    """The groups as rows of text below a row of titles."""
    kinds = {1: "length", 2: "area", 3: "volume"}
    titles = ("group", "dimension", "entities", "measure", "mean outward normal")
    return [titles] + [
        (r.name, str(r.dim), str(r.count), f"{kinds[r.dim]} {r.measure:.6g}", r.facing())
        for r in rows
    ]
