"""The nodes of facets in a space of functions."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from contact_locking.arrays import IndexArray
from contact_locking.mesh.domain import Domain


def facet_places(domain: Domain, facets: IndexArray, cells: IndexArray) -> IndexArray:
    """(m,) which facet of its cell each of m local facets is."""
    topology, dim = domain.mesh.topology, domain.dim
    topology.create_connectivity(dim, dim - 1)
    all_facets = topology.connectivity(dim, dim - 1).array
    facets_of = all_facets.reshape(-1, len(domain.kind.facets))
    return np.argmax(facets_of[cells] == facets[:, None], axis=1).astype(np.int32)


def facet_nodes(
    domain: Domain, space: fem.FunctionSpace, facets: IndexArray, cells: IndexArray
) -> IndexArray:
    """The local nodes (m, n) of facets (m,) with their cells (m,), the corners first."""
    place, layout = facet_places(domain, facets, cells), space.dofmap.dof_layout
    numbers = range(len(domain.kind.facets))
    closure = np.array([layout.entity_closure_dofs(domain.dim - 1, i) for i in numbers])
    return np.asarray(space.dofmap.list[cells[:, None], closure[place]])
