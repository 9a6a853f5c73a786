"""The equilibrated stress of a body and its distance from the stress of a displacement.

The stress has the least complementary energy, by hybridisation: on each triangle the stresses have
the given divergence exactly, and Lagrange multipliers on the facets make the traction continuous
and give it the prescribed values on the boundary:

    sum_K N_K H_K^-1 N_K^T L = t - sum_K (n_K + N_K H_K^-1 r_K),

where H_K is the matrix of ``int C s : s``, and N_K maps the coefficients of the divergence-free
stresses of K to the moments of their tractions.  The matrix is symmetric and positive definite.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from contact_locking.arrays import BoolArray, FloatArray, flattened
from contact_locking.certificate.indicator import nodal_means
from contact_locking.certificate.penalty_error import NotApplicable
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.errors import raise_callback_error
from contact_locking.fem import compiled
from contact_locking.laws.body import MANDEL_PAIRS
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.problem.elasticity import matrix_of
from contact_locking.solver.ksp import create_ksp, default_options, destroy_ksp
from contact_locking.theory.triangles import (
    TENSORS,
    MacroElement,
    Triangles,
    lagrange_gradients,
)

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
        divergence = flattened(np.einsum("nij,ntlj->ntli", np.linalg.inv(maps), -forces.body))
        lifted = divergence @ element.lifts.reshape(divergence.shape[1], -1)
        self._lifted = triangles.moved(lifted.reshape(n, *element.basis.shape[1:]))
        lifted = divergence @ element.lift_moments.reshape(divergence.shape[1], -1)
        lifted = np.einsum("nij,nfkj->nfki", maps, lifted.reshape(n, *element.moments.shape[1:]))
        self._of_lift = flattened(lifted * factors[..., None])
        self._moments = flattened(forces.moments)
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
        for share, block in zip(element.quarters, np.moveaxis(compliance, 2, 0), strict=True):
            pull -= share @ self._lifted @ block
        pull = (flattened(pull, kept=1) @ triangles.transforms) * areas[:, None, None]
        forces = flattened(pull) @ element.basis.reshape(count, -1).T
        right = np.concatenate([forces[:, :, None], np.swapaxes(self._tractions, 1, 2)], axis=2)
        solved = np.linalg.solve(self._stiffness(compliance), right)
        local = self._tractions @ solved
        jumps = self._moments - self._of_lift - local[:, :, 0]
        jumps[self._held] = 0.0
        multipliers = self._multipliers(local[:, :, 1:], jumps)
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

    def _multipliers(self, blocks: FloatArray, right: FloatArray) -> FloatArray:
        """The multipliers (n, 3 b) of the triangles, for right-hand sides (n, 3 b); collective."""
        b, x = self._vector(), self._vector()
        matrix = self._matrix(b, blocks)
        comm = self._triangles.domain.comm
        options = default_options(self._linear, 2, matrix.getSize()[0], comm)
        ksp = create_ksp(comm, options | {"ksp_rtol": _RTOL}, prefix=_PREFIX)
        try:
            ksp.setOperators(matrix)
            self._sum(b, right)
            ksp.solve(b, x)
            x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
            with x.localForm() as local:
                return np.asarray(local.array_r[self._places].reshape(right.shape))
        except PETSc.Error as error:
            raise_callback_error(error)
            raise NotApplicable("the linear solve for the stress failed") from error
        finally:
            destroy_ksp(ksp)
            for petsc_object in (b, x, matrix):
                petsc_object.destroy()

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
        self._sum(sums, np.where(self._held, 0.0, moments - self._moments))
        jump = float(sums.norm(PETSc.NormType.INFINITY))
        sums.destroy()
        largest = maximum(self._triangles.domain.comm, np.abs(moments))
        return jump / largest if largest > 0.0 else 0.0


# The body stiffened by zeta >= 0 where it locks: A + zeta in place of A.
#
# For ``phi(e) = A e : e/2`` with ``|e| <= M`` the conjugate is
#
#     phi*(s) = min over zeta >= 0 of (A + zeta)^-1 s : s/2 + zeta M^2/2,
#
# so that every zeta gives an upper bound of phi*.

# Newton's method for zeta is monotone and ends with rounding; every value in between is a bound.
_STEPS = 30
# Rounds of the stress and zeta, the share of the distance above which a round is the last one, and
# the power of the change of zeta after the first three.
_ROUNDS, _ENOUGH, _BEYOND = 10, 0.985, 1.5
# The least zeta relative to A, so that cells may begin to lock.
_LEAST = 1e-4


def best_stiffening(squares: FloatArray, eigenvalues: FloatArray, limit: FloatArray) -> FloatArray:
    """The zeta (...,) that minimises ``sum_a S_a/(a + zeta)/2 + zeta L/2``.

    ``squares`` (..., 3) are the integrals S_a of the squared components of a stress along the
    eigenvectors of A, ``eigenvalues`` (..., 3) the eigenvalues a, and ``limit`` (...,) the
    integrals L of M^2.  zeta is 0 where L is infinite.
    """
    zeta = np.zeros(squares.shape[:-1])
    aim = 1.0 / np.sqrt(limit)
    for _ in range(_STEPS):
        shifted = eigenvalues + zeta[..., None]
        first = np.sum(squares / shifted**2, axis=-1)
        second = np.sum(squares / shifted**3, axis=-1)
        # Newton's method for the concave function first^-1/2, which is affine for equal a.
        root = np.sqrt(np.maximum(first, 1e-300))
        slope = second / np.maximum(first * root, 1e-300)
        step = np.where(
            (aim > 0.0) & (second > 0.0), (aim - 1.0 / root) / np.maximum(slope, 1e-300), 0.0
        )
        new = np.maximum(zeta + step, 0.0)
        if np.all(np.abs(new - zeta) <= 1e-14 * (np.abs(new) + eigenvalues[..., 0])):
            break
        zeta = new
    return zeta


# Values at the points of a cell that differ by more, relatively, do so by more than rounding.
_ROUNDING = 1e-10


@dataclass(frozen=True)
class Gap:
    """``values`` (n,) are the gaps of the cells of this rank.

    ``zeta`` (n, 3, 4) is that of the quarters of each part.  ``apart`` (n, 3, 4, 3) are the squares
    of ``eps(w) - (A + zeta)^-1 s``, integrated over each quarter, along the eigenvectors of A;
    ``elastic`` (n, 3, 4, 3) are the eigenvalues of A, and ``stiffened`` (n, 3, 4, 3) those of
    A + zeta.
    """

    values: FloatArray
    zeta: FloatArray
    apart: FloatArray
    elastic: FloatArray
    stiffened: FloatArray


class Body:
    """The material of n triangles, constant in each; the constructor is collective.

    ``limit`` (n,) is M, and ``eigenvalues`` (n, 3) are those of A.  Raises NotApplicable for a
    material that varies in a cell of the mesh.
    """

    def __init__(self, state: SolvedState, triangles: Triangles, element: MacroElement) -> None:
        self._state, self.triangles, self.element = state, triangles, element
        points = state.points
        self.limit = self._constant(points.by_cell(points.limit))
        problem, mesh = state.problem, state.problem.domain.mesh
        space = problem.element.strain_space(mesh, (3, 3))
        function = fem.Function(space)
        matrix = matrix_of(problem.material.linear, MANDEL_PAIRS[2], 2)
        function.interpolate(compiled.interpolation(matrix, space))
        dofs = space.dofmap.list[: len(triangles.areas)]
        stiffness = self._constant(function.x.array.reshape(-1, 3, 3)[dofs])
        self.eigenvalues, self._vectors = np.linalg.eigh(stiffness)
        ratio = np.linalg.norm(points.locking_stress, axis=(1, 2)) / points.limit
        # Z alternates between the cells of a locked zone, and means over patches do not.
        means = points.by_cell(ratio).mean(axis=1)[:, None]
        around = nodal_means(triangles.vertex_map, triangles.vertices, means, triangles.areas)
        self._zeta = around.mean(axis=(1, 2))
        self._zeta[~np.isfinite(self.limit)] = 0.0
        self._locks = on_any_rank(state.comm, np.isfinite(self.limit))

    def balanced(self, forces: Forces, w: fem.Function) -> FloatArray:
        """An equilibrated stress (n, 3, m, 3) near that of the displacement w; collective.

        The stress has the least energy for given zeta, and zeta is then the best for this stress,
        until the distance hardly falls.  Raises NotApplicable if rounding leaves the tractions of
        the first stress discontinuous.
        """
        element, triangles, state = self.element, self.triangles, self._state
        system = HybridSystem(triangles, element, forces, state.settings.linear)
        strains, vectors = self.strains(w), self._vectors[:, None, None]
        least = (self.eigenvalues[:, 0] * _LEAST)[:, None, None]
        zeta = np.broadcast_to(self._zeta[:, None, None], (len(least), 3, len(element.quarters)))
        best, least_value, before = None, np.inf, np.inf
        for step in range(_ROUNDS):
            # (A + zeta)^-1 in the quarters, as matrices (n, 3, 4, 3, 3).
            stiffened = self.eigenvalues[:, None, None] + zeta[..., None]
            compliance = vectors / stiffened[..., None, :] @ np.swapaxes(vectors, 3, 4)
            stress, jump = system.solve(compliance, strains)
            if jump > LARGEST_JUMP and best is None:
                raise NotApplicable(f"rounding leaves jumps of {jump:.1e} in the tractions")
            if jump > LARGEST_JUMP:
                break
            gap = self.gap(stress, w)
            value = state.sum(gap.values)
            if value < least_value:
                best, least_value = stress, value
            if not self._locks or (step > 1 and value > _ENOUGH * before):
                break
            before = value
            # Steps beyond the best zeta need fewer rounds.
            power = 1.0 if step < 3 else _BEYOND
            zeta = np.maximum(zeta, least)
            zeta = zeta * (np.maximum(gap.zeta, least) / zeta) ** power
            zeta[~np.isfinite(self.limit)] = 0.0
        assert best is not None
        return best

    def strains(self, u: fem.Function) -> FloatArray:
        """The strain (n, 3, m, 3) of a displacement at the points of the parts."""
        triangles, points = self.triangles, self.element.points
        slopes = lagrange_gradients(self.element.degree, points.reshape(-1, 2))
        slopes = slopes @ np.linalg.inv(triangles.maps)[:, None]
        gradient = np.swapaxes(triangles.at_nodes(u), 1, 2)[:, None] @ slopes
        strains = gradient.reshape(*gradient.shape[:2], 4) @ TENSORS.reshape(3, 4).T
        return np.asarray(strains.reshape(len(strains), *points.shape[:2], 3))

    def excess(self, w: fem.Function) -> float:
        """``max |eps(w)|/M - 1`` over the body, at least 0; collective."""
        ratio = np.linalg.norm(self.strains(w), axis=3) / self.limit[:, None, None]
        return maximum(self._state.comm, ratio - 1.0)

    def gap(self, stress: FloatArray, w: fem.Function) -> Gap:
        """``int |s - (A + zeta) eps|^2/2 + zeta (M^2 - |eps|^2)/2`` over the cells of this rank.

        zeta is constant in each quarter of the three parts of a triangle, and the best one for the
        stress.  Solutions of the inequality keep the limit up to the tolerance of the solver; for
        the share by which eps(w) exceeds M, M is enlarged.
        """
        areas = self.triangles.areas[:, None, None] / 3.0

        def squares(modes: FloatArray) -> FloatArray:
            """(n, 3, 4, 3) from modes (n, 3, 4 or 1, m, 3)."""
            return np.sum(modes * (self.element.quarters @ modes), axis=3) * areas[..., None]

        def modes_of(tensors: FloatArray) -> FloatArray:
            """Components (n, 3, 1, m, 3) of Mandel vectors (n, 3, m, 3) along the eigenvectors."""
            coefficients = flattened(tensors, kept=1) @ self._vectors
            return np.asarray(coefficients.reshape(tensors.shape))[:, :, None]

        eps, modes = modes_of(self.strains(w)), modes_of(stress)
        size = np.sum(squares(eps), axis=3)
        eigenvalues = np.broadcast_to(self.eigenvalues[:, None, None], (*size.shape, eps.shape[4]))
        locks = np.isfinite(self.limit)
        most = np.where(locks, self.limit, 0.0)[:, None, None] ** 2 * areas / size.shape[2]
        most = np.where(locks[:, None, None], np.maximum(most, size), np.inf)
        zeta = best_stiffening(squares(modes), eigenvalues, most)
        shifted = eigenvalues + zeta[..., None]
        apart = squares(modes - shifted[:, :, :, None] * eps) / shifted**2
        slack = np.where(zeta > 0.0, most - size, 0.0)
        values = 0.5 * (np.sum(apart * shifted, axis=(1, 2, 3)) + np.sum(zeta * slack, axis=(1, 2)))
        return Gap(values, zeta, apart, eigenvalues, shifted)

    def _constant(self, values: FloatArray) -> FloatArray:
        """The value (n, ...) in each cell of values (n, points, ...); collective."""
        first = values[:, :1]
        with np.errstate(invalid="ignore"):
            varies = np.abs(values - first) > _ROUNDING * np.abs(first).max(initial=0.0)
        if on_any_rank(self._state.comm, varies):
            raise NotApplicable("the material varies in a cell")
        return np.asarray(first[:, 0])
