"""R, the smoothing of the normal stress on Gamma_C that makes Coulomb friction non-local.

R maps nodal values (k,) at the owned nodes of Gamma_C to such values.  Every ``apply`` is
collective, and the result does not depend on the distribution of the nodes.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.contact.surface_mesh import SurfaceMesh
from contact_locking.parallel import on_every_rank

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

# The angles of Gauss's rule around a circle: k is smooth.
_ANGLES = 24
# The largest distance over the radius at which k is computed; k is 0 there in double precision.
_LARGEST = 1.0 - 1e-4
# An entry of a surface Laplacian above this share of the diagonal is not rounding.
_POSITIVE = 1e-12


class Smoothing:
    """A linear map of the nodal values on Gamma_C, symmetric unless a subclass says otherwise.

    ``keeps_constants`` says that R of 1 is 1 at the free nodes; otherwise it is at most 1.
    """

    keeps_constants = True

    def apply(self, values: FloatArray) -> FloatArray:
        """``R w`` (k,) from ``w`` (k,) at the owned nodes; collective."""
        raise NotImplementedError

    def adjoint(self, values: FloatArray) -> FloatArray:
        """``R* v`` (k,) with ``int (R w) v = int w (R* v)`` by the vertex rule; collective."""
        return self.apply(values)

    def norm(self) -> float:
        """An upper bound of ``|R w|/|w|`` in L2 by the vertex rule over free nodes; collective."""
        return 1.0

    def is_positive(self) -> bool:
        """Whether R is known to have no negative entry, ``R w >= 0`` for ``w >= 0``; collective."""
        return True

    def destroy(self) -> None:
        """Destroy the PETSc objects; collective."""


class Identity(Smoothing):
    """``R w = w``: local Coulomb friction, the limit of a radius r -> 0."""

    def apply(self, values: FloatArray) -> FloatArray:
        return values.copy()


class ConvolutionOperator(Smoothing):
    """``(R w)(x) = int k(|x-y|) w(y) dy / int k(|x-y|) dy``, ``k(d) = exp(-1/(1 - (d/r)^2))``.

    The kernel k is smooth and vanishes for ``d >= r``.  Because of the denominator, R keeps
    constants at every point, also near the ends of Gamma_C.  Integrals use the vertex rule, and
    ``|x-y|`` is the distance along Gamma_C (``SurfaceMesh.within``).  Of an axisymmetric body, y
    runs around the circles as well: with the distance s along the half section,
    ``|x-y|^2 = s^2 + 4 r_x r_y sin^2(angle/2)``.

    ``surface`` is Gamma_C with the weight 0 at held nodes, whose normal displacement is prescribed:
    held nodes carry no pressure, and their weights in the denominator would lower R at the nodes
    around.  ``radius`` is the length r.  The matrix of all pairs of nodes is made when R is first
    used, as `check` does not use R.
    """

    def __init__(self, comm: MPI.Intracomm, surface: SurfaceMesh, radius: float) -> None:
        self._comm, self._surface, self._radius = comm, surface, radius

    def apply(self, values: FloatArray) -> FloatArray:
        return np.asarray(self._matrix @ np.concatenate(self._comm.allgather(values)))

    def adjoint(self, values: FloatArray) -> FloatArray:
        own, weights = self._surface.own, self._surface.weights
        sums = self._comm.allreduce(self._matrix.T @ (weights[own] * values))
        shares = np.divide(sums, weights, out=np.zeros_like(weights), where=weights > 0.0)
        return np.asarray(shares[own])

    def norm(self) -> float:
        return self._norm

    def is_positive(self) -> bool:
        return bool(np.all(self._surface.weights >= 0.0))

    @cached_property
    def _matrix(self) -> csr_matrix:
        """The rows (k, m) of this rank; not collective."""
        from scipy.sparse import csr_matrix

        surface, radius = self._surface, self._radius
        weights = surface.weights
        counts = np.zeros(len(weights[surface.own]), dtype=np.int32)
        columns: list[IndexArray] = [np.empty(0, dtype=np.int32)]
        shares: list[FloatArray] = [np.empty(0)]
        for row, column, distance in surface.within(radius):
            apart = np.asarray(distance / radius)
            kernel = _kernel(apart)
            if surface.axisymmetric:
                radii = surface.points[:, 0]
                chord = 2.0 / radius * np.sqrt(radii[surface.own][row] * radii[column])
                kernel = _around(apart, np.asarray(chord))
            kernel = kernel * weights[column]
            first, last = row[0], row[-1] + 1
            total = np.bincount(row - first, kernel)[row - first]
            counts[first:last] = np.bincount(row - first)
            columns.append(column.astype(np.int32))
            # A held node without free nodes around has nothing to average, and no friction.
            none = np.zeros_like(kernel)
            shares.append(np.divide(kernel, total, out=none, where=total > 0.0))
        starts = np.concatenate([[0], np.cumsum(counts)])
        shape = len(counts), len(weights)
        return csr_matrix((np.concatenate(shares), np.concatenate(columns), starts), shape=shape)

    @cached_property
    def _norm(self) -> float:
        # |R| <= sqrt(|R|_1 |R|_inf), and |R|_inf = 1.
        weights = self._surface.weights
        columns = self._comm.allreduce(self._matrix.T @ weights[self._surface.own])
        ratio = np.divide(columns, weights, out=np.zeros_like(weights), where=weights > 0.0)
        return float(np.sqrt(np.max(ratio, initial=1.0)))


def _kernel(distance: FloatArray) -> FloatArray:
    """K of distances below 1, as multiples of the radius."""
    return np.asarray(np.exp(-1.0 / (1.0 - distance**2)))


def _around(distance: FloatArray, chord: FloatArray) -> FloatArray:
    """The mean of ``k(sqrt(distance^2 + chord^2 sin^2(angle/2)))`` over a whole turn.

    The part of the turn where k is positive ends at an angle that Gauss's rule goes up to.
    """
    room = np.sqrt(1.0 - distance**2)
    end = 2.0 * np.arcsin(np.minimum(1.0, room / np.maximum(chord, room)))
    places, weights = np.polynomial.legendre.leggauss(_ANGLES)
    mean = np.zeros_like(distance)
    for place, weight in zip(0.5 * (1.0 + places), 0.5 * weights, strict=True):
        apart = np.hypot(distance, chord * np.sin(0.5 * place * end))
        mean += weight * _kernel(np.minimum(apart, _LARGEST))
    return mean * end / np.pi


class HelmholtzOperator(Smoothing):
    """``(I - r^2 Laplace_Gamma) w~ = w`` with natural conditions: ``(m + r^2 K) w~ = m w``.

    ``surface`` is Gamma_C with the lumped mass m as weights.  The mass is 0 at held nodes, whose
    normal displacement is prescribed; the equation there is ``K w~ = 0``, which moves the natural
    condition to the free nodes around.  ``stiffness`` is the surface Laplacian K, a distributed
    matrix with the owned nodes as local rows.  ``radius`` is the length r.

    The lumped mass keeps the filtered values positive where K is an M-matrix.  Because of K 1 = 0
    the filter keeps the mean over each connected part of Gamma_C.  The mean is subtracted before
    the solve and added afterwards, because the rounding in ``r^2 K`` would change the mean for a
    large radius.  R is symmetric in the lumped product, with eigenvalues 1/(1 + r^2 k), k >= 0.
    The constructor is collective.
    """

    def __init__(
        self, comm: MPI.Intracomm, surface: SurfaceMesh, stiffness: PETSc.Mat, radius: float
    ) -> None:
        self._comm, self._surface = comm, surface
        # A connected part without a free node would make the matrix singular; no friction acts
        # there.
        is_held = surface.mean_by_part((surface.weights > 0.0).astype(float)) == 0.0
        self._mass = np.where(is_held, 1.0, surface.weights)
        self._operator = stiffness.copy()
        self._operator.scale(radius**2)
        self._rhs = stiffness.createVecLeft()
        self._solution = stiffness.createVecLeft()
        self._rhs.array_w[:] = self._mass[surface.own]
        self._operator.setDiagonal(self._operator.getDiagonal() + self._rhs)
        self._solver = PETSc.KSP().create(stiffness.getComm())
        self._solver.setOperators(self._operator)
        self._solver.setErrorIfNotConverged(True)
        self._solver.setType(PETSc.KSP.Type.PREONLY)
        pc = self._solver.getPC()
        pc.setType(PETSc.PC.Type.LU)
        pc.setFactorSolverType("mumps")

    def apply(self, values: FloatArray) -> FloatArray:
        everywhere = np.concatenate(self._comm.allgather(values))
        mean = self._surface.mean_by_part(everywhere, self._mass)
        own = self._surface.own
        self._rhs.array_w[:] = (self._mass * (everywhere - mean))[own]
        self._solver.solve(self._rhs, self._solution)
        rest = np.concatenate(self._comm.allgather(self._solution.array_r))
        return np.asarray((mean + rest - self._surface.mean_by_part(rest, self._mass))[own])

    def is_positive(self) -> bool:
        # The inverse of an M-matrix has no negative entry.  K has positive entries beside its
        # diagonal where triangles are obtuse, and for quadratic elements.
        entries, rows = [], range(*self._operator.getOwnershipRange())
        for row in rows:
            columns, values = self._operator.getRow(row)
            entries.append(values[columns != row].max(initial=0.0))
        diagonal = self._operator.getDiagonal()
        largest = float(np.max(entries, initial=0.0))
        positive = largest <= _POSITIVE * diagonal.max()[1]
        diagonal.destroy()
        return on_every_rank(self._comm, positive)

    def destroy(self) -> None:
        for item in (self._solver, self._operator, self._rhs, self._solution):
            item.destroy()
