"""The equilibrated stress of a body and its distance from the stress of a displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray, flattened
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.certificate.indicator import nodal_means
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.fem import compiled
from contact_locking.laws.elasticity import MANDEL_PAIRS
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.problem.elasticity import matrix_of
from contact_locking.theory.guaranteed.hybrid_system import LARGEST_JUMP, Forces, HybridSystem
from contact_locking.theory.guaranteed.triangles import (
    TENSORS,
    MacroElement,
    Triangles,
    lagrange_gradients,
)

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
    wanted = 1.0 / np.sqrt(limit)
    for _ in range(_STEPS):
        shifted = eigenvalues + zeta[..., None]
        first = np.sum(squares / shifted**2, axis=-1)
        second = np.sum(squares / shifted**3, axis=-1)
        # Newton's method for the concave function first^-1/2, which is affine for equal a.
        root = np.sqrt(np.maximum(first, 1e-300))
        slope = second / np.maximum(first * root, 1e-300)
        step = np.where(
            (wanted > 0.0) & (second > 0.0), (wanted - 1.0 / root) / np.maximum(slope, 1e-300), 0.0
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
        found = gradient.reshape(*gradient.shape[:2], 4) @ TENSORS.reshape(3, 4).T
        return np.asarray(found.reshape(len(found), *points.shape[:2], 3))

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
            found = flattened(tensors, kept=1) @ self._vectors
            return np.asarray(found.reshape(tensors.shape))[:, :, None]

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
