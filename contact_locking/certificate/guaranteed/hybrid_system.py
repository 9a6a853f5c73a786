"""The stress with the least complementary energy, by hybridisation.

On each triangle the stresses have the given divergence exactly.  Lagrange multipliers on the facets
make the traction continuous and give it the prescribed values on the boundary:

    sum_K N_K H_K^-1 N_K^T L = t - sum_K (n_K + N_K H_K^-1 r_K),

where H_K is the matrix of ``int C s : s``, and N_K maps the coefficients of the divergence-free
stresses of K to the moments of their tractions.  The matrix is symmetric and positive definite.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import la
from petsc4py import PETSc

from contact_locking.arrays import BoolArray, FloatArray, flattened
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.certificate.guaranteed.macro_element import MacroElement
from contact_locking.certificate.guaranteed.triangles import Triangles
from contact_locking.errors import raise_callback_error
from contact_locking.solver.linear.ksp import create_ksp, default_options, destroy_ksp

# A prefix of its own: the options for the nonlinear solve do not concern these solves.
_PREFIX = "contact_locking_stress_"
_RTOL = 1e-12
#: The largest relative jump of tractions that counts as rounding.
LARGEST_JUMP = 1e-8


@dataclass(frozen=True)
class Boundary:
    """The conditions for the tractions on the facets of each triangle.

    ``held`` (n, 3, 2) marks the components with prescribed displacements, where the traction is
    free.  ``moments`` (n, 3, k + 1, 2) are the moments of the prescribed tractions.  ``springs``
    (n, 3, b, b), for blocks of b = 2 (k + 1) multipliers, fix the rigid motions that no
    displacement condition holds, and are zero elsewhere.
    """

    held: BoolArray
    moments: FloatArray
    springs: FloatArray | None = None


class HybridSystem:
    """The hybrid system of a mesh with given conditions on the boundary.

    :meth:`solve` may be called for several compliances.
    """

    def __init__(
        self, triangles: Triangles, element: MacroElement, boundary: Boundary, linear: str
    ) -> None:
        self.triangles, self.element, self.boundary = triangles, element, boundary
        self._linear = linear
        maps, sizes = triangles.maps, triangles.determinants
        signs = triangles.signs[:, :, None] ** np.arange(element.degree + 1)
        #: Of a reference traction: the factor |F| of the traction, and the direction of the facet.
        self._weights = signs * sizes[:, None, None]
        block = 2 * (element.degree + 1)
        count = len(element.basis)
        # (n, i, f, k, c): the component i of the moment k on the facet f of the basis stress c.
        table = np.moveaxis(element.moments, (3, 0), (0, 3)).reshape(2, -1)
        moved = (maps.reshape(-1, 2) @ table).reshape(-1, 2, 3, element.degree + 1, count)
        tractions = np.moveaxis(moved, 1, 3) * self._weights[:, :, :, None, None]
        held = np.repeat(boundary.held[:, :, None, :], element.degree + 1, axis=2)
        tractions[held] = 0.0
        self._tractions = tractions.reshape(-1, 3 * block, count)
        self._held = held.reshape(-1, 3, block)
        self._block = block

    def moments(self, reference: FloatArray) -> FloatArray:
        """The moments (n, 3, k + 1, 2) of tractions from those (n, 3, k + 1, 2) in the reference.

        The moments are those along the direction that all ranks give to the facets.
        """
        moved = np.einsum("nij,nfkj->nfki", self.triangles.maps, reference)
        return np.asarray(moved * self._weights[:, :, :, None])

    def solve(
        self, compliance: FloatArray, target: FloatArray, lifted: FloatArray
    ) -> tuple[FloatArray, float]:
        """The divergence-free part (n, 3, m, 3) of the stress; collective.

        ``compliance`` (n, 3, 3) is C in each triangle, as a Mandel matrix.  The stress minimises
        ``int C s : s/2 - target : s`` with ``target`` (n, 3, m, 3).  ``lifted`` (n, 3, k + 1, 2)
        are the moments of the tractions of the stress that has the divergence.

        Also returns the largest jump of the moments that is left, relative to the largest moment.
        Raises NotApplicable if the linear solver fails.
        """
        element, triangles = self.element, self.triangles
        transforms, areas = triangles.transforms, triangles.areas / 3.0
        count = len(element.basis)
        # H_K = |K|/3 sum_ab (P^T C P)_ab G_ab.
        gram = np.einsum("itpa,pq,jtqb->abij", element.basis, element.mass, element.basis)
        inner = np.swapaxes(transforms, 1, 2) @ compliance @ transforms
        inner *= areas[:, None, None]
        stiffness = (inner.reshape(-1, 9) @ gram.reshape(9, -1)).reshape(-1, count, count)
        weighted = np.einsum("itpa,pq->tqai", element.basis, element.mass)
        pulled = flattened(target, kept=1) @ (transforms * areas[:, None, None])
        forces = flattened(pulled) @ weighted.reshape(-1, count)
        right = np.concatenate([forces[:, :, None], np.swapaxes(self._tractions, 1, 2)], axis=2)
        solved = np.linalg.solve(stiffness, right)
        local = self._tractions @ solved
        given = flattened(self.boundary.moments) - flattened(lifted) - local[:, :, 0]
        given[flattened(self._held)] = 0.0
        multipliers = self._global(local[:, :, 1:], given)
        coefficients = solved[:, :, :1] + solved[:, :, 1:] @ multipliers[:, :, None]
        moments = flattened(lifted) + (self._tractions @ coefficients)[:, :, 0]
        jump = self._jump(moments)
        stress = coefficients[:, :, 0] @ element.basis.reshape(count, -1)
        return triangles.moved(stress.reshape(target.shape)), jump

    def _global(self, blocks: FloatArray, given: FloatArray) -> FloatArray:
        """The multipliers (n, 3 b) on the facets of each triangle; collective."""
        matrix = self._matrix(blocks)
        comm, facet_map = self.triangles.domain.comm, self.triangles.facet_map
        right = self._summed(given)
        owned = facet_map.size_local * self._block
        b, x = matrix.createVecLeft(), matrix.createVecRight()
        b.array_w[:] = right.array[:owned]
        options = default_options(self._linear, 2, matrix.getSize()[0], comm)
        ksp = create_ksp(comm, options | {"ksp_rtol": _RTOL}, prefix=_PREFIX)
        try:
            ksp.setOperators(matrix)
            ksp.solve(b, x)
            right.array[:owned] = x.array_r
        except PETSc.Error as error:
            raise_callback_error(error)
            raise NotApplicable("the linear solve for the stress failed") from error
        finally:
            destroy_ksp(ksp)
            for item in (b, x, matrix):
                item.destroy()
        right.scatter_forward()
        return flattened(right.array.reshape(-1, self._block)[self.triangles.facets])

    def _matrix(self, blocks: FloatArray) -> PETSc.Mat:
        """The matrix from its blocks (n, 3 b, 3 b) of the triangles; collective."""
        size, facet_map = self._block, self.triangles.facet_map
        values = np.array(blocks).reshape(-1, 3 * size, 3 * size)
        if self.boundary.springs is not None:
            for facet in range(3):
                place = slice(facet * size, (facet + 1) * size)
                values[:, place, place] += self.boundary.springs[:, facet]
        cells, rows = np.nonzero(flattened(self._held))
        values[cells, rows, rows] = 1.0
        facets = facet_map.local_to_global(self.triangles.facets.reshape(-1))
        places = facets.reshape(-1, 3).astype(PETSc.IntType)
        shape = (facet_map.size_local * size, facet_map.size_global * size)
        matrix = PETSc.Mat().create(self.triangles.domain.comm)
        matrix.setSizes((shape, shape), bsize=size)
        matrix.setType(PETSc.Mat.Type.AIJ)
        # A facet is coupled to itself and to the four other facets of its triangles.
        matrix.setPreallocationNNZ((5 * size, 4 * size))
        matrix.setValuesBlockedRCV(places, places, values, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        return matrix

    def _summed(self, values: FloatArray) -> la.Vector:
        """The sum (facets, b) of values (n, 3 b) over the triangles of each facet; collective."""
        vector = la.vector(self.triangles.facet_map, self._block)
        vector.array[:] = 0.0
        blocks = vector.array.reshape(-1, self._block)
        np.add.at(blocks, self.triangles.facets.reshape(-1), values.reshape(-1, self._block))
        vector.scatter_reverse(la.InsertMode.add)
        return vector

    def _jump(self, moments: FloatArray) -> float:
        """The largest sum of moments (n, 3 b) and prescribed moments, over the largest moment."""
        comm = self.triangles.domain.comm
        given = flattened(self.boundary.moments)
        rest = np.where(flattened(self._held), 0.0, moments - given)
        total = self._summed(rest).array[: self.triangles.facet_map.size_local * self._block]
        local = [np.abs(total).max(initial=0.0), np.abs(moments).max(initial=0.0)]
        jump, largest = np.max(comm.allgather(local), axis=0)
        return float(jump / largest) if largest > 0.0 else 0.0
