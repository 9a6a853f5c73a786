"""What a user sees of a solution, as NumPy arrays: all that the judge knows of the package."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from contact_locking.contact.pairing import Side, pair
from contact_locking.mesh.domain import Domain
from contact_locking.results.solution import StudySolution

from .contact import Pairing
from .elements import Array, Body, Index, Mesh


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

    @property
    def criteria(self) -> dict[str, Any]:
        """Those of the certificate."""
        return dict(self.summary["certificate"]["criteria"])


def mesh_of(domain: Domain, space: Any, study: dict[str, Any]) -> Mesh:
    """The mesh with the nodes of displacements, and the parts and regions that a study names."""
    x = space.tabulate_dof_coordinates()[:, : domain.dim].copy()
    cells = np.asarray(space.dofmap.list, dtype=np.int64)
    topology, dim = domain.mesh.topology, domain.dim
    topology.create_connectivity(dim, dim - 1)
    topology.create_connectivity(dim - 1, dim)
    layout = space.dofmap.dof_layout
    closures = [layout.entity_closure_dofs(dim - 1, i) for i in range(len(domain.kind.facets))]
    parts: dict[str, Index] = {}
    for name in _parts(study):
        found = []
        for facet in domain.facets((name,)):
            cell = topology.connectivity(dim - 1, dim).links(facet)[0]
            side = list(topology.connectivity(dim, dim - 1).links(cell)).index(facet)
            found.append(cells[cell][closures[side]])
        parts[name] = np.array(found, dtype=np.int64)
    named = set(study["material"].get("regions", {}))
    given = study["material"].get("eigenstrain", [])
    for item in given if isinstance(given, list) else [given]:
        named |= set(_names(item.get("on", [])))
    groups = {name: np.asarray(domain.cells(name), dtype=np.int64) for name in named}
    return Mesh(x, cells, parts, groups, bool(domain.axisymmetric))


def _names(on: str | list[str]) -> list[str]:
    return [on] if isinstance(on, str) else list(on)


def _parts(study: dict[str, Any]) -> set[str]:
    """The parts of the boundary with loads, conditions and contacts."""
    contact = study["contact"]
    entries = list(contact) if isinstance(contact, list) else [contact]
    for section in study["loads"].values():
        entries += [entry for entry in section if isinstance(entry, dict)]
    return {
        name
        for entry in entries
        for key in ("on", "against")
        for name in _names(entry.get(key) or [])
    }


def pairings_of(
    domain: Domain, mesh: Mesh, study: dict[str, Any], solution: StudySolution | None = None
) -> list[Pairing | None]:
    """The maps between bodies of the package, where bodies faced each other in the last solve."""
    contact = study["contact"]
    sections = contact if isinstance(contact, list) else [contact]
    frames: list[Array | None] = [None] * len(sections)
    if solution is not None:
        frames = [fields.paired_at for fields in solution.contacts]
    body = Body(mesh, study)
    return [
        _paired(domain, body, section, frame) if section.get("against") else None
        for section, frame in zip(sections, frames, strict=True)
    ]


def _paired(domain: Domain, body: Body, section: dict[str, Any], frame: Array | None) -> Pairing:
    x, dim = body.mesh.x, body.dim
    among = set(_names(section["on"])) == set(_names(section["against"]))

    def side(names: list[str]) -> tuple[Side, Index]:
        facets = body.facets(names)
        owners = domain.owners(domain.facets(tuple(names)))
        bodies = domain.parts[owners].astype(np.int64) if among else None
        nodes, numbers = np.unique(facets, return_inverse=True)
        normals = body.normals(facets)
        outward = normals / np.linalg.norm(normals, axis=1)[:, None]
        numbers = numbers.reshape(facets.shape)
        return Side(x[nodes], domain.kind.facet, numbers, outward, bodies), nodes

    (one, nodes), (two, theirs) = (side(_names(section[key])) for key in ("on", "against"))
    moved = np.zeros_like(x) if frame is None else frame.reshape(x.shape)
    if frame is not None:
        one, two = one.moved(moved[nodes]), two.moved(moved[theirs])
    found = pair(one, two)
    shares = found.shares.tocoo()
    shape = (len(nodes), len(x))
    facing = sp.csr_matrix((shares.data, (shares.row, theirs[shares.col])), shape)
    own = sp.csr_matrix((np.ones(len(nodes)), (np.arange(len(nodes)), nodes)), shape)
    jump = (sp.diags(found.faces.astype(float)) @ (found.near @ own - facing)).tocsr()
    extent = float(np.ptp(x, axis=0).max())
    before = np.sum((jump @ moved) * found.normals, axis=1)
    gap = np.where(found.faces, found.gap, extent) + before
    weights = np.where(found.faces, found.weights, extent ** (dim - 1))
    return Pairing(jump, found.faces, weights, found.normals, gap)


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
    tensors = tensors.reshape(len(mesh.cells), -1, size, size)
    pairs = [(0, 1)] if size == 2 or mesh.axisymmetric else [(1, 2), (0, 2), (0, 1)]
    normal = [tensors[..., i, i] for i in range(size)]
    shear = [np.sqrt(2.0) * tensors[..., i, j] for i, j in pairs]
    return np.stack([*normal, *shear], axis=-1)
