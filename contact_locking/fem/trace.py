"""The trace of an element on Gamma_C: the points where contact and friction act, with weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from dolfinx import fem, la

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.mesh.cell_kind import lagrange
from contact_locking.mesh.domain import Domain

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

#: A quadrature rule as the metadata of a measure; the empty rule is exact for polynomials.
Rule = Mapping[str, Any]

# The shares of the values at the ends and in the middle of an edge in the control value of its
# middle, and those of the control values in the value there.
_CONTROL, _NODAL = np.array([-0.5, -0.5, 2.0]), np.array([0.25, 0.25, 0.5])


@dataclass(frozen=True)
class Trace:
    """The points of a facet, which are its nodes, with positive weights, and the values there.

    ``rules`` maps the dimension d to a quadrature rule on the facets whose points are the nodes of
    the displacement.  ``pieces`` maps d to the pieces of a facet, each with d nodes of the facet;
    the nodes of a facet are numbered from 0, with the corners first.  The element has no contact in
    a dimension without entries.

    ``controls`` are the dimensions d in which the laws of contact and friction limit the control
    values of a trace, which are for quadratic displacements; elsewhere they limit the values at the
    nodes.  Control values are the value at a corner, and ``2 u_m - (u_1 + u_2)/2`` at the midpoint
    m of the edge between the corners 1 and 2: the coefficients of the trace in Bernstein's basis
    (docs/problem.md).
    """

    rules: Mapping[int, Rule]
    pieces: Mapping[int, tuple[tuple[int, ...], ...]]
    controls: tuple[int, ...] = ()

    def check(self, dim: int, degree: int, key: str) -> None:
        """Raise InputError with the key if there is no contact in ``dim`` dimensions."""
        if dim not in self.rules:
            raise InputError(
                f"there is no contact in {dim} dimensions for these elements of degree {degree}; "
                "take elements of degree 1",
                key,
            )


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


class ControlValues:
    """The linear map from nodal values on Gamma_C to the values that the laws limit.

    ``scalars`` is the space of scalar fields of the displacement's degree, and ``blocks`` (n,) are
    the n local nodes of ``scalars`` as blocks of the displacements in ``vectors``.  ``nodes`` (k,)
    are the owned nodes of ``scalars`` on Gamma_C.
    """

    def __init__(
        self,
        trace: Trace,
        scalars: fem.FunctionSpace,
        vectors: fem.FunctionSpace,
        nodes: IndexArray,
        blocks: IndexArray,
    ) -> None:
        self._nodes, self.blocks, self._vectors = nodes, blocks, vectors
        #: Whether the limited values are the nodal values.
        self.are_nodal = vectors.mesh.topology.dim not in trace.controls
        no_edges = np.empty((0, 3), dtype=np.int32)
        self._edges = no_edges if self.are_nodal else _edges(scalars, nodes)

    @property
    def rows(self) -> csr_matrix:
        """The map (k, N) from all N blocks of displacements, by their global numbers."""
        from scipy.sparse import csr_matrix

        index_map, local = self._vectors.dofmap.index_map, self.of_blocks
        columns = index_map.local_to_global(local.indices.astype(np.int32))
        shape = (local.shape[0], index_map.size_global)
        return csr_matrix((local.data, columns, local.indptr), shape=shape)

    @property
    def of_blocks(self) -> csr_matrix:
        """The map (k, n) from the values of a displacement at its local blocks."""
        return self._map(self._nodes, self.blocks, _CONTROL)

    def of_scalars(self, function: fem.Function) -> FloatArray:
        """The limited values (k,) of a function of the scalar space."""
        rows = self._map(self._nodes, np.arange(len(self.blocks)), _CONTROL)
        return np.asarray(rows @ function.x.array)

    def forces(self, at_nodes: FloatArray) -> FloatArray:
        """The forces (k, d) on limited values for forces (k, d) on nodal values; collective."""
        if self.are_nodal:
            return at_nodes
        vector = fem.Function(self._vectors).x
        vector.array[:] = (self.inverse(self._nodes, self.blocks).T @ at_nodes).reshape(-1)
        vector.scatter_reverse(la.InsertMode.add)
        return np.asarray(vector.array.reshape(-1, at_nodes.shape[1])[self.blocks[self._nodes]])

    def edges(self, function: fem.Function) -> IndexArray:
        """(m, 3) the ends and the middle of each edge whose middle has a control value.

        They are nodes or blocks of the function.
        """
        return self._edges if function.ufl_shape == () else self.blocks[self._edges]

    def inverse(self, nodes: IndexArray, numbers: IndexArray) -> csr_matrix:
        """The map from limited to nodal values (k, m), for numbers (n,) < m of the local nodes."""
        return self._map(nodes, numbers, _NODAL)

    def _map(self, nodes: IndexArray, numbers: IndexArray, shares: FloatArray) -> csr_matrix:
        """1 at corners, and at each middle the ``shares`` of the nodes of its edge."""
        # `check` does without SciPy, whose import takes a tenth of its time.
        from scipy.sparse import csr_matrix

        row = np.full(len(self.blocks), -1)
        row[nodes] = np.arange(len(nodes))
        middles = self._edges[:, 2]
        corners = np.setdiff1d(nodes, middles)
        rows = np.concatenate([row[corners], np.repeat(row[middles], 3)])
        columns = np.concatenate([corners, self._edges.reshape(-1)])
        values = np.concatenate([np.ones(len(corners)), np.tile(shares, len(middles))])
        shape = (len(nodes), int(numbers.max(initial=-1)) + 1)
        return csr_matrix((values, (rows, numbers[columns])), shape=shape)


def make_nodal(function: fem.Function, places: Sequence[ControlValues]) -> None:
    """Replace limited values, given as values at the nodes, by nodal values; collective.

    This changes the owned nodes of the ``places``, which may overlap.
    """
    values = function.x.array.reshape(-1, *function.ufl_shape)
    limited = values.copy()
    for place in places:
        edges = place.edges(function)
        values[edges[:, 2]] = np.tensordot(_NODAL, limited[edges], axes=(0, 1))
    function.x.scatter_forward()


def _edges(scalars: fem.FunctionSpace, nodes: IndexArray) -> IndexArray:
    """(m, 3) the nodes of the edges whose middles are among ``nodes``: the ends, the middle."""
    element = lagrange(scalars.mesh.topology.cell_name(), 2)
    # The numbers of nodes ascend from the corners to the middle.
    local = np.array([sorted(closure) for closure in element.entity_closure_dofs[1]])
    edges = scalars.dofmap.list[:, local].reshape(-1, 3)
    edges = edges[np.isin(edges[:, 2], nodes)]
    return np.asarray(edges[np.unique(edges[:, 2], return_index=True)[1]])
