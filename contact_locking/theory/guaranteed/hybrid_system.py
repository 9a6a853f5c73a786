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
from petsc4py import PETSc

from contact_locking.arrays import BoolArray, FloatArray, flattened
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.errors import raise_callback_error
from contact_locking.parallel import maximum
from contact_locking.solver.linear.ksp import create_ksp, default_options, destroy_ksp
from contact_locking.theory.guaranteed.triangles import MacroElement, Triangles

# A prefix of its own: the options for the nonlinear solve do not concern these solves.
_PREFIX = "contact_locking_stress_"
_RTOL = 1e-12
#: The largest relative jump of tractions that counts as rounding.
LARGEST_JUMP = 1e-8


@dataclass(frozen=True)
class Forces:
    """The forces that the stresses of n triangles balance.

    ``held`` (n, 3, 2) marks the components with prescribed displacements, where the traction is
    free.  ``body`` (n, 3, l, 2) is the body force, and ``moments`` (n, 3, k + 1, 2) are the moments
    of the prescribed tractions along the directions that all ranks give to the facets.
    """

    held: BoolArray
    body: FloatArray
    moments: FloatArray


class HybridSystem:
    """The hybrid system of a mesh with given forces; collective.

    :meth:`solve` may be called for several compliances.
    """

    def __init__(
        self, triangles: Triangles, element: MacroElement, forces: Forces, linear: str
    ) -> None:
        self._triangles, self._element = triangles, element
        self._linear = linear
        powers, maps, n = np.arange(element.degree + 1), triangles.maps, len(triangles.areas)
        # Of a reference traction: the factor |F| of the traction, and the direction of the facet.
        factors = triangles.signs[:, :, None] ** powers * 2.0 * triangles.areas[:, None, None]
        held = np.repeat(forces.held[:, :, None], len(powers), axis=2)
        basis = np.einsum("nij,cfkj->nfkic", maps, element.moments, optimize=True)
        tractions = np.where(held[..., None], 0.0, basis * factors[..., None, None])
        self._block = 2 * len(powers)
        self._tractions = tractions.reshape(n, 3 * self._block, len(element.basis))
        self._held = flattened(held)
        # s = F r F^T has the divergence F div r.
        wanted = flattened(np.einsum("nij,ntlj->ntli", np.linalg.inv(maps), -forces.body))
        lifted = wanted @ element.lifts.reshape(wanted.shape[1], -1)
        self._lifted = triangles.moved(lifted.reshape(n, *element.basis.shape[1:]))
        lifted = wanted @ element.lift_moments.reshape(wanted.shape[1], -1)
        lifted = np.einsum("nij,nfkj->nfki", maps, lifted.reshape(n, *element.moments.shape[1:]))
        self._of_lift = flattened(lifted * factors[..., None])
        self._wanted = flattened(forces.moments)
        facets = triangles.facets[:, :, None].astype(np.int64) * self._block
        self._places = (facets + np.arange(self._block)).reshape(-1)

    def solve(self, compliance: FloatArray, strains: FloatArray) -> tuple[FloatArray, float]:
        """The stress s that minimises ``int C s : s/2 - eps : s``; collective.

        ``compliance`` (n, 3, 4, 3, 3) is C in the quarters of each part, as a Mandel matrix, and
        ``strains`` (n, 3, m, 3) is eps.  Returns s (n, 3, m, 3), and what is left of the balance of
        the moments, relative to the largest moment.  Raises NotApplicable if the linear solver
        fails.
        """
        element, triangles = self._element, self._triangles
        areas, count = triangles.areas / 3.0, len(element.basis)
        pull = element.mass @ strains
        for share, part in zip(element.quarters, np.moveaxis(compliance, 2, 0), strict=True):
            pull -= share @ self._lifted @ part
        pull = (flattened(pull, kept=1) @ triangles.transforms) * areas[:, None, None]
        forces = flattened(pull) @ element.basis.reshape(count, -1).T
        right = np.concatenate([forces[:, :, None], np.swapaxes(self._tractions, 1, 2)], axis=2)
        solved = np.linalg.solve(self._stiffness(compliance), right)
        local = self._tractions @ solved
        given = self._wanted - self._of_lift - local[:, :, 0]
        given[self._held] = 0.0
        multipliers = self._multipliers(local[:, :, 1:], given)
        coefficients = solved[:, :, 0] + np.einsum("ncb,nb->nc", solved[:, :, 1:], multipliers)
        moments = self._of_lift + np.einsum("nbc,nc->nb", self._tractions, coefficients)
        stress = (coefficients @ element.basis.reshape(count, -1)).reshape(strains.shape)
        return self._lifted + triangles.moved(stress), self._jump(moments)

    def _stiffness(self, compliance: FloatArray) -> FloatArray:
        """``H_K = |K|/3 sum_tsab (P^T C P)_tsab G_tsab`` over the quarters s of the parts t."""
        element, count = self._element, len(self._element.basis)
        transforms = self._triangles.transforms[:, None, None]
        gram = np.einsum("itpa,spq,jtqb->tsabij", element.basis, element.quarters, element.basis)
        inner = np.swapaxes(transforms, 3, 4) @ compliance @ transforms
        inner *= self._triangles.areas[:, None, None, None, None] / 3.0
        return (flattened(inner) @ gram.reshape(-1, count**2)).reshape(-1, count, count)

    def _vector(self) -> PETSc.Vec:
        """A vector of the unknowns with ghosts, a block for each facet; collective."""
        facets, comm = self._triangles.facet_map, self._triangles.domain.comm
        size, ghosts = (facets.size_local * self._block, None), facets.ghosts
        return PETSc.Vec().createGhost(ghosts.astype(PETSc.IntType), size, self._block, comm)

    def _multipliers(self, blocks: FloatArray, given: FloatArray) -> FloatArray:
        """The multipliers (n, 3 b) of the triangles, for right-hand sides (n, 3 b); collective."""
        b, x = self._vector(), self._vector()
        matrix = self._matrix(b, blocks)
        comm = self._triangles.domain.comm
        options = default_options(self._linear, 2, matrix.getSize()[0], comm)
        ksp = create_ksp(comm, options | {"ksp_rtol": _RTOL}, prefix=_PREFIX)
        try:
            ksp.setOperators(matrix)
            self._sum(b, given)
            ksp.solve(b, x)
            x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
            with x.localForm() as local:
                return np.asarray(local.array_r[self._places].reshape(given.shape))
        except PETSc.Error as error:
            raise_callback_error(error)
            raise NotApplicable("the linear solve for the stress failed") from error
        finally:
            destroy_ksp(ksp)
            for item in (b, x, matrix):
                item.destroy()

    def _matrix(self, vector: PETSc.Vec, blocks: FloatArray) -> PETSc.Mat:
        """The matrix from its blocks (n, 3 b, 3 b); collective."""
        size, values = self._block, np.array(blocks)
        cells, rows = np.nonzero(self._held)
        values[cells, rows, rows] = 1.0
        matrix = PETSc.Mat().create(vector.getComm())
        matrix.setSizes((vector.getSizes(),) * 2, bsize=size)
        matrix.setType(PETSc.Mat.Type.AIJ)
        # A facet is coupled to itself and to four others, of its triangles.
        matrix.setPreallocationNNZ((5 * size, 4 * size))
        matrix.setLGMap(vector.getLGMap())
        facets = self._triangles.facets.astype(PETSc.IntType)
        matrix.setValuesBlockedLocalRCV(facets, facets, values, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        return matrix

    def _sum(self, vector: PETSc.Vec, values: FloatArray) -> None:
        """Set a vector to the sums of values (n, 3 b) at the unknowns; collective."""
        with vector.localForm() as local:
            local.array_w[:] = np.bincount(self._places, values.reshape(-1), local.getSize())
        vector.ghostUpdate(PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)

    def _jump(self, moments: FloatArray) -> float:
        """What is left of the balance of the moments, over the largest moment; collective."""
        sums = self._vector()
        self._sum(sums, np.where(self._held, 0.0, moments - self._wanted))
        jump = float(sums.norm(PETSc.NormType.INFINITY))
        sums.destroy()
        largest = maximum(self._triangles.domain.comm, np.abs(moments))
        return jump / largest if largest > 0.0 else 0.0
