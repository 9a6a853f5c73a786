"""Supports along the normal of the boundary or along a given direction: ``u . m = value``."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from dolfinx import fem

from contact_locking import _compat
from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.fem.fields import Clock, PresentValue
from contact_locking.fem.spaces import facet_nodes
from contact_locking.mesh.data import corner_normals
from contact_locking.mesh.distribution import summed
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import agree, on_every_rank
from contact_locking.supports.support import Displacement, Support

# The rounding of a unit vector: a direction within this distance of an axis is along the axis.
_ALONG_AXIS = 1e-14
#: The sine of the angle between two directions that count as one.
SAME = 1e-6
#: A facet belongs to a smooth boundary if its normal is within this cosine of that at a node.
SMOOTH = float(np.cos(np.radians(30.0)))


@dataclass(frozen=True)
class PlacedSupport:
    """A direction m that is held on the boundary parts ``on``, with its ``key``.

    ``nodes`` (k,) are local, ghosts included, at ``points`` (d, k) and with m in ``directions``
    (k, d).  ``sign`` times ``present`` is the displacement along m.  ``component`` is the number of
    the axis that m is everywhere, None if it is no axis.
    """

    on: tuple[str, ...]
    key: str
    nodes: IndexArray
    points: FloatArray
    directions: FloatArray
    present: PresentValue
    component: int | None = None
    sign: float = 1.0
    is_normal: bool = False

    @property
    def dofs(self) -> IndexArray | None:
        """The local dofs (k,) that are held, None if m is no axis."""
        axis = self.component
        return None if axis is None else self.directions.shape[1] * self.nodes + np.int32(axis)

    def value(self, x: FloatArray) -> FloatArray:
        """The present displacements (k,) along m at points (d, k); collective."""
        return self.sign * self.present(x)

    def read(self) -> FloatArray:
        """The present displacements (k,) along m at the nodes; collective."""
        return self.value(self.points)

    def rows_at(self, nodes: IndexArray) -> tuple[IndexArray, FloatArray]:
        """The directions at those of the given nodes that the support holds.

        Returns the positions (m,) in ``nodes`` and the directions (m, d).
        """
        places = np.flatnonzero(np.isin(nodes, self.nodes)).astype(np.int32)
        return places, self.directions[np.searchsorted(self.nodes, nodes[places])]


def placed_supports(
    domain: Domain, space: fem.FunctionSpace, condition: Support | Displacement, clock: Clock
) -> Iterator[PlacedSupport]:
    """The support on the mesh, or one for each prescribed component; collective.

    Raises InputError for a boundary part whose normal jumps at a node.
    """
    facets, axes = domain.facets(condition.on, f"{condition.key}.on"), np.eye(domain.dim)
    nodes = np.unique(fem.locate_dofs_topological(space, domain.dim - 1, facets)).astype(np.int32)
    points = np.asarray(space.tabulate_dof_coordinates()[nodes, : domain.dim].T)
    if isinstance(condition, Displacement):
        for axis, component in enumerate(condition.value):
            if component is not None:
                key, along = f"{condition.key}.value.{axis}", np.tile(axes[axis], (len(nodes), 1))
                present = PresentValue(component, key, clock)
                yield PlacedSupport(condition.on, key, nodes, points, along, present, axis)
        return
    present = PresentValue(condition.value, f"{condition.key}.value", clock)
    is_normal = condition.along == "normal"
    if is_normal:
        along = _nodal_normals(domain, space, condition, facets)[nodes]
    else:
        along = np.tile(
            np.array(condition.along) / np.linalg.norm(condition.along), (len(nodes), 1)
        )
    held = PlacedSupport(
        condition.on, condition.key, nodes, points, along, present, is_normal=is_normal
    )
    for axis, sign in itertools.product(range(domain.dim), (-1.0, 1.0)):
        away = np.abs(along - sign * axes[axis]).max(initial=0.0)
        if on_every_rank(domain.comm, bool(away <= _ALONG_AXIS)):
            # Without the rounding of normals.
            exact = np.tile(axes[axis], (len(nodes), 1))
            held = replace(held, directions=exact, component=axis, sign=sign)
    yield held


def pseudo_inverse(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The projections (k, d, d) onto the spans of rows (k, r, d), and the pseudo-inverses.

    The pseudo-inverses (k, d, r) map the prescribed components to the displacement in the span.
    """
    left, sizes, right = np.linalg.svd(rows, full_matrices=False)
    kept = sizes > SAME
    held = np.einsum("ksi,ks,ksj->kij", right, kept.astype(float), right)
    over = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=kept)
    return held, np.einsum("ksi,ks,krs->kir", right, over, left)


def _nodal_normals(
    domain: Domain, space: fem.FunctionSpace, support: Support, facets: IndexArray
) -> FloatArray:
    """The outward unit normals (k, d) at the local nodes of a support, 0 elsewhere; collective.

    The normal at a vertex is the mean of the normals of the facets of the support around the
    vertex with the weights of `corner_normals`, and is exact on a circle or a sphere.
    """
    dim, mesh = domain.dim, domain.mesh
    cells = domain.owners(facets)
    # A ghost of a facet counts on the rank that owns the cell.
    owned = cells < mesh.topology.index_map(dim).size_local
    facets, cells = facets[owned], cells[owned]
    nodes, facet = facet_nodes(domain, space, facets, cells), domain.kind.facet
    corners = space.tabulate_dof_coordinates()[nodes[:, : facet.corners], :dim]
    units, weights = corner_normals(facet, corners)
    # At the other nodes of quadratic displacements the facets count alike.
    others = nodes.shape[1] - facet.corners
    weights = np.concatenate([weights, np.ones((len(nodes), others))], axis=1)
    inside = mesh.geometry.x[_compat.cell_corners(mesh)[cells]][..., :dim].mean(axis=1)
    outward = corners.mean(axis=1) - inside
    units = units * np.sign(np.sum(units * outward[:, None], axis=2))[..., None]
    means = units.mean(axis=1, keepdims=True)
    further = np.repeat(means, nodes.shape[1] - units.shape[1], axis=1)
    units = np.concatenate([units, further], axis=1)
    sums = summed(space.dofmap.index_map, nodes, weights[..., None] * units)
    sizes = np.linalg.norm(sums, axis=1, keepdims=True)
    normals = np.divide(sums, sizes, out=np.zeros_like(sums), where=sizes > 0.0)
    cosines = np.einsum("fnd,fnd->fn", normals[nodes], units)

    def refuse_edge() -> None:
        if cosines.size and cosines.min() < SMOOTH:
            facet, place = np.unravel_index(np.argmin(cosines), cosines.shape)
            where = domain.where(space.tabulate_dof_coordinates()[nodes[facet, place], :dim])
            raise InputError(
                f"the boundary has an edge at {where}, where the normal jumps; give each side of "
                "the edge its own name and entry",
                f"{support.key}.along",
            )

    agree(domain.comm, refuse_edge)
    return normals
