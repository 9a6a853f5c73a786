"""Names for parts of the boundary by their place."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.errors import InputError
from contact_locking.mesh.boundary_parts import marked, tags_of
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.skins import Skins
from contact_locking.parallel import on_any_rank

# A point is on a plane, or in a box, up to this share of the size of the body.
_ROUNDING = 1e-6
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
    marks = {name: marked(mesh, domain.facets((name,))) for name in domain.facet_names}
    mesh.topology.create_connectivity(dim - 1, dim)
    outside = marked(mesh, np.asarray(dmesh.exterior_facet_indices(mesh.topology)))
    every = np.flatnonzero(outside).astype(np.int32)
    corners = mesh.geometry.x[_compat.entities_to_geometry(mesh, dim - 1, every), :dim]
    centres = corners.mean(axis=1, keepdims=True)
    points = np.concatenate([corners + _PULLED * (centres - corners), centres], axis=1)
    rounding = _ROUNDING * float(np.ptp(domain.bounding_box, axis=0).max())
    for name, place in places.items():
        own = f"{key}.{name}"
        if name in marks:
            raise InputError(f"{domain.origin} has a boundary part with this name already", own)
        held = place.holds(points.reshape(-1, dim).T, rounding)
        found = held.reshape(points.shape[:2]).all(axis=1)
        if place.facing is not None:
            normals, areas = domain.area_normals(every)
            found &= normals @ place.facing > _ALONG * np.linalg.norm(place.facing) * areas
        if place.skin is not None:
            found &= marked(mesh, Skins.of(domain).of_kind(place.skin))[every]
        marks[name] = np.zeros_like(outside)
        marks[name][every] = found
        if place.on:
            domain.require_names(place.on, marks, f"{own}.on")
            marks[name] &= np.any([marks[part] for part in place.on], axis=0)
        if not on_any_rank(mesh.comm, bool(marks[name].any())):
            low, high = (domain.where(end) for end in domain.bounding_box)
            skin = "" if place.skin is None else _NO_SKIN
            raise InputError(
                f"catches no facet of the boundary, which is between {low} and {high}{skin}", own
            )
    tags, names = tags_of(mesh, marks)
    return dataclasses.replace(domain, facet_tags=tags, facet_names=names)
