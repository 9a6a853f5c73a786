"""The trace of an element on Gamma_C: the points where contact and friction act, with weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.fem import gauss_points

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

#: A quadrature rule as the metadata of a measure; the empty rule is exact for polynomials.
Rule = Mapping[str, Any]


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
    m of the edge between the corners 1 and 2.  These are the coefficients of the trace in
    Bernstein's basis, whose functions are not negative, have the sum 1, and have equal integrals
    over a facet.
    Therefore, on a flat facet,

    - control values of ``u_nu - gap`` that are not positive imply ``u_nu <= gap`` everywhere, if
      the gap is quadratic,
    - ``sum_i w_i G |c_i| >= int G |u_tau|`` for the control values c of ``u_tau`` and a constant G.
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

    def limited_space(self, vectors: fem.FunctionSpace) -> fem.FunctionSpace:
        """The space of fields with limited values at the nodes; collective.

        A field has the degrees of freedom of the displacement in ``vectors`` whose limited values
        are the values of the field at the nodes.  All contacts of a problem share this space, as
        the arguments of a form have one space.
        """
        return _control_space(vectors) if vectors.mesh.topology.dim in self.controls else vectors


class PointValues:
    """The linear map from nodal values on Gamma_C to the values that the laws limit.

    ``scalars`` is the space of scalar fields of the displacement's degree, ``limited`` is
    :meth:`Trace.limited_space` of displacements, and ``blocks`` (n,) are the n local nodes of
    ``scalars`` as blocks of ``limited``.  ``nodes`` (k,) are the owned nodes of ``scalars`` on
    Gamma_C.  The functions of ``limited`` have the degrees of freedom of displacements, and at the
    nodes of Gamma_C the limited values of the displacement with the same ones.  The constructor is
    collective.
    """

    def __init__(
        self,
        trace: Trace,
        scalars: fem.FunctionSpace,
        limited: fem.FunctionSpace,
        nodes: IndexArray,
        blocks: IndexArray,
    ) -> None:
        self._nodes, self.blocks, self.space = nodes, blocks, limited
        #: Whether the limited values are the nodal values.
        self.are_nodal = limited.mesh.topology.dim not in trace.controls
        self._middles: IndexArray = np.empty(0, np.int32)
        self._ends: IndexArray = np.empty((0, 2), np.int32)
        if not self.are_nodal:
            self._middles, self._ends = _edges(scalars, nodes)

    @cached_property
    def matrix(self) -> csr_matrix:
        """The map (k, n) from the values of a displacement at its local blocks."""
        return self._map(self._nodes, self.blocks, own=2.0, end=-0.5)

    @property
    def by_blocks(self) -> csr_matrix:
        """The same map (k, N) for all N blocks of displacements, by their global numbers."""
        from scipy.sparse import csr_matrix

        index_map, local = self.space.dofmap.index_map, self.matrix
        columns = index_map.local_to_global(local.indices.astype(np.int32))
        shape = (local.shape[0], index_map.size_global)
        return csr_matrix((local.data, columns, local.indptr), shape=shape)

    @cached_property
    def _of_scalars(self) -> csr_matrix:
        return self._map(self._nodes, np.arange(len(self.blocks)), own=2.0, end=-0.5)

    def of(self, v: Expr) -> Expr:
        """A function or an argument of ``space`` with the degrees of freedom of ``v``."""
        if self.space is v.ufl_function_space():
            return v
        if isinstance(v, fem.Function):
            return fem.Function(self.space, x=v.x, name=v.name)
        return ufl.Argument(self.space, v.number(), v.part())

    def of_function(self, function: fem.Function) -> FloatArray:
        """The limited values (k,) of a scalar or (k, d) of a vector function."""
        shape = function.ufl_shape
        if self.are_nodal:
            nodes = self.blocks[self._nodes] if shape else self._nodes
            return np.asarray(function.x.array.reshape(-1, *shape)[nodes])
        if shape == ():
            return np.asarray(self._of_scalars @ function.x.array)
        return np.asarray(self.matrix @ function.x.array.reshape(-1, *shape))

    def refresh(self) -> None:
        """Take the present values of displacements; collective."""

    def at_nodes(self, values: FloatArray) -> FloatArray:
        """The displacement or the jump (k, d) at the nodes, for local values; collective."""
        dim = self.space.dofmap.index_map_bs
        return np.asarray(values.reshape(-1, dim)[self.blocks[self._nodes]])

    def forces(self, at_nodes: FloatArray) -> FloatArray:
        """The forces at all local dofs of displacements for forces (k, d) on limited values.

        Collective.
        """
        forces = fem.Function(self.space)
        forces.x.array[:] = (self.matrix.T @ at_nodes).reshape(-1)
        forces.x.scatter_reverse(la.InsertMode.add)
        forces.x.scatter_forward()
        return np.asarray(forces.x.array)

    def limited_forces(self, scalars: fem.FunctionSpace, at_nodes: FloatArray) -> FloatArray:
        """The forces (k, d) on limited values for forces (k, d) on the values at the nodes.

        ``scalars`` is the space of scalar fields.  Collective.
        """
        if self.are_nodal:
            return at_nodes
        found = np.empty_like(at_nodes)
        work = fem.Function(scalars)
        transposed = self.inverse(self._nodes, np.arange(len(self.blocks))).T
        for component in range(at_nodes.shape[1]):
            work.x.array[:] = transposed @ at_nodes[:, component]
            work.x.scatter_reverse(la.InsertMode.add)
            found[:, component] = work.x.array[self._nodes]
        return found

    def edges(self, function: fem.Function) -> tuple[IndexArray, IndexArray]:
        """The midpoints (m,) of edges, and the ends (m, 2), as nodes or blocks of a function."""
        if function.ufl_shape == ():
            return self._middles, self._ends
        return self.blocks[self._middles], self.blocks[self._ends]

    def inverse(self, nodes: IndexArray, numbers: IndexArray) -> csr_matrix:
        """The map from limited to nodal values (k, m), for numbers (n,) < m of the local nodes."""
        return self._map(nodes, numbers, own=0.5, end=0.25)

    def destroy(self) -> None:
        """Free PETSc's objects; collective."""

    def _map(self, nodes: IndexArray, numbers: IndexArray, own: float, end: float) -> csr_matrix:
        """1 at corners, and ``own`` and twice ``end`` at midpoints and the ends of their edges."""
        # `check` does without SciPy, whose import takes a tenth of its time.
        from scipy.sparse import csr_matrix

        row = np.full(len(self.blocks), -1)
        row[nodes] = np.arange(len(nodes))
        middles = row[self._middles]
        diagonal = np.ones(len(nodes))
        diagonal[middles] = own
        rows = np.concatenate([np.arange(len(nodes)), np.repeat(middles, 2)])
        columns = numbers[np.concatenate([nodes, self._ends.reshape(-1)])]
        values = np.concatenate([diagonal, np.full(self._ends.size, end)])
        shape = (len(nodes), int(numbers.max(initial=-1)) + 1)
        return csr_matrix((values, (rows, columns)), shape=shape)


def displacement_map(rows: csr_matrix, vectors: fem.FunctionSpace) -> PETSc.Mat:
    """The matrix of a map (k, N) of blocks, by global numbers, for each component; collective.

    Its rows are k nodes of each rank, with the components of each node together.
    """
    from scipy.sparse import identity, kron

    index_map, dim = vectors.dofmap.index_map, vectors.dofmap.index_map_bs
    each = kron(rows, identity(dim), format="csr")
    return PETSc.Mat().createAIJ(
        ((each.shape[0], None), (dim * index_map.size_local, None)),
        csr=(each.indptr.astype(PETSc.IntType), each.indices.astype(PETSc.IntType), each.data),
        comm=vectors.mesh.comm,
    )


def make_nodal(function: fem.Function, places: Sequence[PointValues]) -> None:
    """Replace limited values, given as values at the nodes, by nodal values; collective.

    This changes the owned nodes of the ``places``, which may overlap.
    """
    values = function.x.array.reshape(-1, *function.ufl_shape)
    limited = values.copy()
    for place in places:
        middles, ends = place.edges(function)
        values[middles] = 0.5 * limited[middles] + 0.25 * np.sum(limited[ends], axis=1)
    function.x.scatter_forward()


def _control_space(vectors: fem.FunctionSpace) -> fem.FunctionSpace:
    """The space in which nodal values u belong to the field with the control values at the nodes.

    At a midpoint this field has the value ``2 u_m - (u_1 + u_2)/2``.  The degrees of freedom of a
    field v are therefore ``v_m/2 + (v_1 + v_2)/4``, and ``v_1`` at a corner; collective.
    """
    mesh = vectors.mesh
    dim, cell = mesh.topology.dim, basix.CellType[mesh.topology.cell_name()]
    corners, topology = basix.geometry(cell), basix.topology(cell)
    nodes = gauss_points.nodes(mesh.topology.cell_name(), 2)
    points: list[list[FloatArray]] = [[] for _ in range(4)]
    shares: list[list[FloatArray]] = [[] for _ in range(4)]

    def add(entity: int, places: FloatArray, *weights: float) -> None:
        points[entity].append(places)
        dofs = 1 if weights else 0
        shares[entity].append(np.array(weights).reshape(dofs, 1, len(places), 1))

    for (corner,) in topology[0]:
        add(0, corners[[corner]], 1.0)
    for ends in topology[1]:
        add(1, np.vstack([corners[ends].mean(axis=0), corners[ends]]), 0.5, 0.25, 0.25)
    # Inside of boxes are the last nodes, one in each entity of simplices none.
    count = len(topology[0]) + len(topology[1])
    inner = iter(np.split(nodes[count:], max(len(nodes) - count, 1)))
    for entity in range(2, dim + 1):
        for _ in topology[entity]:
            place = next(inner, nodes[:0])
            add(entity, place, *[1.0] * len(place))
    element = basix.ufl.custom_element(
        cell,
        [],
        np.eye(len(nodes)),
        points,
        shares,
        0,
        basix.MapType.identity,
        basix.SobolevSpace.H1,
        discontinuous=False,
        embedded_subdegree=2,
        embedded_superdegree=2,
    )
    return fem.functionspace(mesh, basix.ufl.blocked_element(element, shape=(dim,)))


def _edges(scalars: fem.FunctionSpace, nodes: IndexArray) -> tuple[IndexArray, IndexArray]:
    """The m of ``nodes`` that are midpoints of edges, and the ends (m, 2) of these edges."""
    layout, cell = scalars.dofmap.dof_layout, scalars.mesh.topology.cell_name()
    local = []
    for edge in range(len(basix.topology(basix.CellType[cell])[1])):
        (middle,) = layout.entity_dofs(1, edge)
        local.append([middle, *(i for i in layout.entity_closure_dofs(1, edge) if i != middle)])
    found = scalars.dofmap.list[:, np.array(local)].reshape(-1, 3)
    found = found[np.isin(found[:, 0], nodes)]
    found = found[np.unique(found[:, 0], return_index=True)[1]]
    return found[:, 0], found[:, 1:]
