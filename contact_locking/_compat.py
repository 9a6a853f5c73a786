"""Every difference between DOLFINx 0.9, 0.10 and 0.11 that this package meets, and nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx import mesh as dmesh

try:  # DOLFINx >= 0.10
    from dolfinx.io import gmsh as _gmshio
except ImportError:  # DOLFINx 0.9
    from dolfinx.io import gmshio as _gmshio


def model_to_mesh(model: Any, comm: Any, rank: int, dim: int) -> tuple[dmesh.Mesh, Any, Any]:
    """Mesh, cell tags and facet tags of a gmsh model that lives on one rank."""
    data = _gmshio.model_to_mesh(model, comm, rank, gdim=dim)
    return data[0], data[1], data[2]


def interpolation_expression(expr: Any, space: Any) -> fem.Expression:
    """``expr`` as DOLFINx interpolates it into ``space``."""
    points = space.element.interpolation_points
    return fem.Expression(expr, points() if callable(points) else points)


def entities_to_geometry(mesh: dmesh.Mesh, dim: int, entities: Any) -> npt.NDArray[np.int32]:
    """Geometry nodes (k, nodes per entity); DOLFINx 0.9 divides by zero if there are none."""
    if len(entities) == 0:
        return np.empty((0, dim + 1), dtype=np.int32)
    mesh.topology.create_connectivity(dim, mesh.topology.dim)
    return dmesh.entities_to_geometry(mesh, dim, entities)


def collapse(component: Any) -> tuple[fem.FunctionSpace, npt.NDArray[np.int32]]:
    """The space of a component and its dofs in the whole; DOLFINx 0.11 nests the latter."""
    space, dofs = component.collapse()
    return space, np.asarray(dofs, dtype=np.int32).reshape(-1)


def point_owners(data: Any) -> npt.NDArray[np.int32]:
    """The ranks that own the points of interpolation data, -1 where none does."""
    owners = data.src_owner
    return np.asarray(owners() if callable(owners) else owners)
