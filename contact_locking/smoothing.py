"""R, the mollifier of the normal stress on Gamma_C that makes Coulomb friction non-local.

R acts on nodal values: one number per node of Gamma_C, held by the rank that owns the node.  Every
``apply`` is collective and its result does not depend on how the nodes are distributed.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]


class Smoothing(Protocol):
    """A linear map on the nodal values of Gamma_C that keeps constants."""

    def apply(self, values: FloatArray) -> FloatArray:
        """``R w`` at the owned nodes from ``w`` at the owned nodes; collective."""

    def norm(self) -> float:
        """An upper bound of ``|R w|/|w|`` in L2(Gamma_C)."""

    def destroy(self) -> None:
        """Free what PETSc holds; collective."""


class Identity:
    """``R w = w``: local Coulomb friction, the limit r -> 0."""

    def apply(self, values: FloatArray) -> FloatArray:
        return values.copy()

    def norm(self) -> float:
        return 1.0

    def destroy(self) -> None:
        pass


class Convolution:
    """``(R w)(x) = int k(|x-y|) w(y) dy / int k(|x-y|) dy``, ``k(d) = exp(-1/(1 - (d/r)^2))``.

    The kernel vanishes for ``d >= r`` and is smooth.  The denominator keeps constants at every
    point, also near the ends of Gamma_C.  Integrals use the nodal weights of the vertex rule.

    ``points`` (k, d) and ``weights`` (k,) belong to the owned nodes, ``radius`` is a length.
    """

    def __init__(
        self, comm: MPI.Intracomm, points: FloatArray, weights: FloatArray, radius: float
    ) -> None:
        self._comm = comm
        everywhere = np.concatenate(comm.allgather(points))
        all_weights = np.concatenate(comm.allgather(weights))
        shape = (len(points), len(everywhere))
        if 0 in shape:
            self._matrix = csr_matrix(shape)
            self._norm = self._bound(weights, all_weights)
            return
        pairs = cKDTree(points).sparse_distance_matrix(
            cKDTree(everywhere), radius, output_type="ndarray"
        )
        inside = pairs["v"] < radius * (1.0 - 1e-12)
        row, column, distance = (pairs[name][inside] for name in "ijv")
        kernel = np.exp(-1.0 / (1.0 - (distance / radius) ** 2)) * all_weights[column]
        total = np.bincount(row, kernel, minlength=len(points))
        self._matrix = csr_matrix((kernel / total[row], (row, column)), shape=shape)
        self._norm = self._bound(weights, all_weights)

    def apply(self, values: FloatArray) -> FloatArray:
        return self._matrix @ np.concatenate(self._comm.allgather(values))

    def norm(self) -> float:
        return self._norm

    def _bound(self, weights: FloatArray, all_weights: FloatArray) -> float:
        """``sqrt(|R|_1 |R|_inf)`` with ``|R|_inf = 1``; collective."""
        columns = self._comm.allreduce(self._matrix.T @ weights)
        return float(np.sqrt(np.max(columns / all_weights, initial=1.0)))

    def destroy(self) -> None:
        pass


class HelmholtzFilter:
    """``(I - r^2 Laplace_Gamma) w~ = w`` with natural ends: ``(m + r^2 K) w~ = m w``.

    ``mass`` (k,) is the lumped surface mass at the owned nodes, ``stiffness`` the P1 surface
    Laplacian K on Gamma_C as a distributed matrix whose local rows are those nodes.  The lumped
    mass keeps the filtered values positive where K is an M-matrix.  K 1 = 0 keeps the mean over
    each connected part of Gamma_C; as ``r^2 K`` is rounded, a large radius would lose it, so that
    the mean is taken off before and put back after.
    """

    def __init__(self, mass: FloatArray, stiffness: PETSc.Mat, radius: float) -> None:
        self._mass = mass
        self._comm = stiffness.getComm().tompi4py()
        self._count, self._part = _connected_parts(stiffness, self._comm)
        self._part_mass = self._sums(mass)
        self._operator = stiffness.copy()
        self._operator.scale(radius**2)
        self._rhs = stiffness.createVecLeft()
        self._solution = stiffness.createVecLeft()
        self._rhs.array_w[:] = mass
        self._operator.setDiagonal(self._operator.getDiagonal() + self._rhs)
        self._solver = PETSc.KSP().create(stiffness.getComm())
        self._solver.setOperators(self._operator)
        self._solver.setErrorIfNotConverged(True)
        self._solver.setType(PETSc.KSP.Type.PREONLY)
        pc = self._solver.getPC()
        pc.setType(PETSc.PC.Type.LU)
        pc.setFactorSolverType("mumps")

    def apply(self, values: FloatArray) -> FloatArray:
        mean = self._means(values)
        self._rhs.array_w[:] = self._mass * (values - mean)
        self._solver.solve(self._rhs, self._solution)
        rest = self._solution.array_r.copy()
        return mean + rest - self._means(rest)

    def norm(self) -> float:
        # Symmetric in the lumped product, with eigenvalues 1/(1 + r^2 k) and k >= 0.
        return 1.0

    def _means(self, values: FloatArray) -> FloatArray:
        """At each node the mean over its connected part of Gamma_C; collective."""
        return (self._sums(self._mass * values) / self._part_mass)[self._part]

    def _sums(self, values: FloatArray) -> FloatArray:
        """The sum over each connected part; collective."""
        return self._comm.allreduce(np.bincount(self._part, values, minlength=self._count))

    def destroy(self) -> None:
        for item in (self._solver, self._operator, self._rhs, self._solution):
            item.destroy()


def _connected_parts(stiffness: PETSc.Mat, comm: MPI.Intracomm) -> tuple[int, IntArray]:
    """The number of connected parts of Gamma_C, and the part of each owned node; collective."""
    starts, columns, values = stiffness.getValuesCSR()
    first, last = stiffness.getOwnershipRange()
    rows = np.repeat(np.arange(first, last), np.diff(starts))
    largest = comm.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)
    joined = np.abs(values) > 1e-12 * largest
    row, column = (
        np.concatenate(comm.allgather(ends[joined].astype(np.int64))) for ends in (rows, columns)
    )
    size = stiffness.getSize()[0]
    graph = csr_matrix((np.ones(len(row)), (row, column)), shape=(size, size))
    count, part = connected_components(graph, directed=False)
    return int(count), part[first:last]
