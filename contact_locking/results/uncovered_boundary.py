"""Entries of the boundary outside of Gamma_C into a foundation; no contact keeps it out there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import maximum

# Of the extent of the body.
_FLAT = 1e-9


@dataclass(frozen=True)
class UncoveredEntry:
    """How deep the boundary outside of one contact's part of Gamma_C enters its foundation.

    ``depth`` is a length, 0 where nothing enters; ``place`` (d,) is the deepest point before the
    body moved.
    """

    depth: float
    place: tuple[float, ...]


def uncovered_entry(domain: Domain, u: fem.Function, contact: NodalContact) -> UncoveredEntry:
    """The deepest entry of the moved boundary ``x + u(x)``, judged at its nodes; collective.

    The rest of a flat side, of which a part is pressed by a half space, is left out.
    """
    dim, space = domain.dim, u.function_space
    exterior = dmesh.exterior_facet_indices(domain.mesh.topology)
    nodes = np.setdiff1d(
        fem.locate_dofs_topological(space, dim - 1, exterior),
        fem.locate_dofs_topological(space, dim - 1, contact.surface.facets),
    )
    nodes = nodes[nodes < space.dofmap.index_map.size_local]
    places = space.tabulate_dof_coordinates()[nodes, :dim]
    if contact.foundation.is_plane:
        # A flat punch is a half space that ends where the part of the flat side ends.
        apart = ~_on_flat_side(domain, contact, places)
        nodes, places = nodes[apart], places[apart]
    moved = places + u.x.array.reshape(-1, dim)[nodes]
    # A foundation that a force has moved is entered like one at rest by a body that moved back.
    depths = np.maximum(-contact.foundation.distance((moved - contact.travel.at(places)).T), 0.0)
    found: tuple[float, list[float]] = (0.0, [])
    if len(depths):
        deepest = int(np.argmax(depths))
        found = float(depths[deepest]), places[deepest].tolist()
    depth, place = max(domain.comm.allgather(found))
    return UncoveredEntry(depth, tuple(place))


def _on_flat_side(domain: Domain, contact: NodalContact, places: FloatArray) -> BoolArray:
    """Which places (k, d) lie in the plane of one contact's part of Gamma_C if it is flat."""
    normals, points = contact.surface.body_normals(), contact.surface.points
    own = [(normals[0], points[0])] if len(points) else []
    normal, point = next(pair for pairs in domain.comm.allgather(own) for pair in pairs)
    near = _FLAT * domain.extent
    heights = np.abs((points - point) @ normal)
    if maximum(domain.comm, heights) > near:
        return np.zeros(len(places), dtype=bool)
    return np.asarray(np.abs((places - point) @ normal) <= near)
