"""What a user sees of a solution, as NumPy arrays; the only module of the judge with DOLFINx."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from contact_locking.results.solution import StudySolution

from .own_body import Array, Index, Mesh


@dataclass(frozen=True)
class Touch:
    """The nodal fields of a contact, in ascending order of the nodes of the mesh."""

    pressure: Array
    traction: Array
    bound: Array
    smoothed: Array
    gap: Array
    normal: Array


@dataclass(frozen=True)
class Moment:
    """A solution: nodal ``u`` (k, d), stresses (c, p, m), contacts and the summary."""

    time: float
    u: Array
    elastic: Array
    locking: Array
    contacts: tuple[Touch, ...]
    summary: dict[str, Any]


def mesh_of(solution: StudySolution, names: set[str], regions: set[str]) -> Mesh:
    """The mesh with the nodes of displacements, the parts ``names`` of the boundary and regions."""
    domain, space = solution.domain, solution.displacement.function_space
    x = space.tabulate_dof_coordinates()[:, : domain.dim].copy()
    cells = np.asarray(space.dofmap.list, dtype=np.int64)
    topology, dim = domain.mesh.topology, domain.dim
    topology.create_connectivity(dim, dim - 1)
    topology.create_connectivity(dim - 1, dim)
    layout = space.dofmap.dof_layout
    closures = [layout.entity_closure_dofs(dim - 1, i) for i in range(dim + 1)]
    parts: dict[str, Index] = {}
    for name in names:
        found = []
        for facet in domain.facets((name,)):
            cell = topology.connectivity(dim - 1, dim).links(facet)[0]
            side = list(topology.connectivity(dim, dim - 1).links(cell)).index(facet)
            found.append(cells[cell][closures[side]])
        parts[name] = np.array(found, dtype=np.int64)
    groups = {name: np.asarray(domain.cells(name), dtype=np.int64) for name in regions}
    return Mesh(x, cells, parts, groups, bool(domain.axisymmetric))


def moment_of(solution: StudySolution, mesh: Mesh) -> Moment:
    """The fields of a solution, copied, in the order of the mesh."""
    dim = mesh.dim
    touches = []
    for fields in solution.contacts:
        order = np.argsort(fields.surface.blocks)
        columns = (
            fields.pressure,
            fields.traction,
            fields.bound,
            fields.smoothed_stress,
            fields.gap,
            fields.normal,
        )
        touches.append(Touch(*(np.array(column)[order] for column in columns)))
    return Moment(
        time=float(solution.time) if solution.parameters.steps is not None else 1.0,
        u=solution.displacement.x.array.reshape(-1, dim).copy(),
        elastic=_mandel(solution.elastic_stress, mesh),
        locking=_mandel(solution.locking_stress, mesh),
        contacts=tuple(touches),
        summary={**solution.summary},
    )


def _mandel(function: Any, mesh: Mesh) -> Array:
    """(c, p, m) of tensors at the points of the law."""
    size = function.ufl_shape[0]
    dofs = function.function_space.dofmap.list
    tensors = function.x.array.reshape(-1, size, size)[dofs]
    pairs = [(0, 1)] if size == 2 or mesh.axisymmetric else [(1, 2), (0, 2), (0, 1)]
    normal = [tensors[..., i, i] for i in range(size)]
    shear = [np.sqrt(2.0) * tensors[..., i, j] for i, j in pairs]
    return np.stack([*normal, *shear], axis=-1)
