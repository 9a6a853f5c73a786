"""Displacements from mesh to mesh."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from contact_locking import _compat
from contact_locking.parallel import maximum, on_any_rank

# A node may lie outside the other mesh by this share of the body because of rounding.
_PADDING = 1e-8


def on_mesh_of(u: fem.Function, other: fem.Function) -> fem.Function:
    """``u`` interpolated into the space of ``other``, on the same or another mesh; collective.

    Raises ValueError if a node of ``other`` lies in no cell of the mesh of u.
    """
    space, source = other.function_space, u.function_space
    found = fem.Function(space)
    if source.mesh is space.mesh:
        found.interpolate(u)
        return found
    mesh = space.mesh
    cells = mesh.topology.index_map(mesh.topology.dim)
    everywhere = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
    x = source.mesh.geometry.x
    padding = _PADDING * maximum(source.mesh.comm, np.abs(x))
    owners = fem.create_interpolation_data(space, source, everywhere, padding=padding)
    if on_any_rank(mesh.comm, _compat.point_owners(owners) < 0):
        raise ValueError("the mesh of the reference reaches beyond the mesh of the solution")
    found.interpolate_nonmatching(u, everywhere, owners)
    found.x.scatter_forward()
    return found
