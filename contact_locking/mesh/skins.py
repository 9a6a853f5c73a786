"""The skins of the bodies: the connected parts of their boundary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.file.topology import components
from contact_locking.mesh.half_section import is_on_axis

# A skin encloses a body if the body is thicker than this share of its length.
_THIN = 1e-9


@dataclass(frozen=True)
class Skins:
    """The skins of the bodies: parts of the boundary whose facets are joined, by edges in 3D.

    ``facets`` (k,) are the owned facets of the boundary, ``numbers`` (k,) those of their skins,
    ``normals`` (k, d) and ``areas`` (k,) as :meth:`Domain.area_normals`.  ``is_inner`` (s,) marks
    the skins that enclose no body: ``int x . nu <= 0``, as of a cavity or a crack.  A cavity that a
    plane of symmetry cuts is a part of the outer skin; one on the axis of a body of revolution is a
    skin, as the axis is no boundary.
    """

    facets: IndexArray
    numbers: IntArray
    normals: FloatArray
    areas: FloatArray
    is_inner: BoolArray

    @classmethod
    def of(cls, domain: Domain) -> Skins:
        """The skins of a domain; collective."""
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
        numbers = _joined(np.concatenate(comm.allgather(ridges.reshape(ends.shape))))
        own = numbers[sum(comm.allgather(len(facets))[: comm.rank]) :][: len(facets)]
        normals, areas = domain.area_normals(facets)
        # A skin is closed, or ends on the axis, where x = 0: the origin changes nothing.
        middle = domain.bounding_box.mean(axis=0)
        middle[0] *= not domain.axisymmetric
        heights = np.sum((nodes.mean(axis=1) - middle) * normals, axis=1)
        count = int(numbers.max(initial=-1)) + 1
        inside, size = (
            comm.allreduce(np.bincount(own, values, count)) for values in (heights, areas)
        )
        return cls(facets, own, normals, areas, inside <= _THIN * domain.extent * size)

    def of_kind(self, kind: str) -> IndexArray:
        """The owned facets of the skins of a kind, inner or outer."""
        return self.facets[self.is_inner[self.numbers] == (kind == "inner")]


def _joined(ridges: IntArray) -> IntArray:
    """The component (k,) of each facet with the ridges (k, n)."""
    count, (names, rows) = len(ridges), np.unique(ridges, return_inverse=True)
    facets = np.repeat(np.arange(count), ridges.shape[1])
    pairs = np.column_stack([facets, count + rows.reshape(-1)])
    return components(pairs, count + len(names))[1][:count]
