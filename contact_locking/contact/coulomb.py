"""Coulomb friction: its law, the friction bound on the mesh, and R, which smooths normal stresses.

The friction bound ``G = mu(s) |R sigma_nu|`` depends on the solution; ``s`` is ``|u_tau|`` in the
static problem, and the accumulated slip in a process.  For a known bound the functional of friction
is convex, and the solvers rely on this.  R maps nodal values (k,) at the owned nodes of Gamma_C to
such values.  Every ``apply`` is collective, and the result does not depend on the distribution of
the nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import AXES, FloatArray, IndexArray
from contact_locking.contact.surface import ContactSurface, SurfaceMesh
from contact_locking.errors import InputError, NotConverged, with_key
from contact_locking.parallel import agree, maximum, on_every_rank
from contact_locking.values.value import Value

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Coefficient = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class FrictionLaw:
    """``mu(x, s) <= largest`` and ``|mu(x, s) - mu(x, t)| <= lipschitz |s - t|``, as (12) asks.

    ``coefficient`` maps points (k, d) and slips ``s = |u_tau|`` (k,) to ``mu`` (k,), or to one
    number.  ``largest`` is mu*, and ``lipschitz`` is L_mu, one over a length.  The certificate
    takes both constants as the law states them.  Where a constant is None, the certificate samples
    mu, which proves nothing.
    """

    coefficient: Coefficient
    largest: float | None = None
    lipschitz: float | None = None

    def __call__(self, points: FloatArray, slip: FloatArray) -> FloatArray:
        values = np.asarray(self.coefficient(points, slip), dtype=float)
        if values.shape not in ((), slip.shape):
            raise InputError(
                f"the coefficient of friction has values of the shape {values.shape} at "
                f"{len(slip)} points: it maps points (k, d) and slips (k,) to values (k,), as "
                "lambda x, s: 0.1 + 0.2*x[:, 0] does"
            )
        return np.broadcast_to(values, slip.shape)


# The angles of Gauss's rule around a circle: k is smooth.
_ANGLES = 24
# The largest distance over the radius at which k is computed; k is 0 there in double precision.
_LARGEST = 1.0 - 1e-4
# An entry of a surface Laplacian above this share of the diagonal is not rounding.
_POSITIVE = 1e-12


class Smoothing:
    """R, a linear map of nodal values (k,) on Gamma_C; symmetric unless a subclass says otherwise.

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
        rows, weights = self._surface.owned, self._surface.weights
        sums = self._comm.allreduce(self._matrix.T @ (weights[rows] * values))
        shares = np.divide(sums, weights, out=np.zeros_like(weights), where=weights > 0.0)
        return np.asarray(shares[rows])

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
        counts = np.zeros(len(weights[surface.owned]), dtype=np.int32)
        columns: list[IndexArray] = [np.empty(0, dtype=np.int32)]
        shares: list[FloatArray] = [np.empty(0)]
        for row, column, distance in surface.within(radius):
            apart = np.asarray(distance / radius)
            kernel = _kernel(apart)
            if surface.axisymmetric:
                radii = surface.points[:, 0]
                chord = 2.0 / radius * np.sqrt(radii[surface.owned][row] * radii[column])
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
        columns = self._comm.allreduce(self._matrix.T @ weights[self._surface.owned])
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
        is_held = np.bincount(surface.parts, surface.weights)[surface.parts] == 0.0
        self._mass = np.where(is_held, 1.0, surface.weights)
        self._operator = stiffness.copy()
        self._operator.scale(radius**2)
        self._rhs = stiffness.createVecLeft()
        self._solution = stiffness.createVecLeft()
        self._rhs.array_w[:] = self._mass[surface.owned]
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
        rows = self._surface.owned
        self._rhs.array_w[:] = (self._mass * (everywhere - mean))[rows]
        self._solver.solve(self._rhs, self._solution)
        deviation = np.concatenate(self._comm.allgather(self._solution.array_r))
        return np.asarray(
            (mean + deviation - self._surface.mean_by_part(deviation, self._mass))[rows]
        )

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
        for petsc_object in (self._solver, self._operator, self._rhs, self._solution):
            petsc_object.destroy()


# The default radius of R is this share of the extent of Gamma_C.  It is at least twice the longest
# facet: the kernel vanishes at the radius, and R has to reach the neighbours of each node.
_DEFAULT_RADIUS_SHARE, _DEFAULT_RADIUS_FACETS = 0.1, 2.0
# A negative friction coefficient smaller than this share of the largest value is zero with
# rounding.
_ROUNDING = 1e-12
#: A filter with a larger radius than this share of the extent is the mean over Gamma_C to nine
#: digits.
LARGEST_RADIUS_SHARE = 1e4
# The central differences of mu take steps of this share of the slip.
_DIFFERENCE = 1e-3


class FrictionBound:
    """``G(p, s) = mu(x, s) |R p|`` (6): the bound of the friction traction at the nodes.

    ``law`` maps points (k, d) and accumulated slips s (k,) to ``mu`` (k,): the coefficient of
    a :class:`Coulomb`, a :class:`~contact_locking.contact.coulomb.FrictionLaw`, or a function, for
    which the certificate samples mu* and L_mu.  ``smoothing`` is R.  ``frictionless`` says that
    mu is zero everywhere.  A user's own friction bound is a subclass with another :meth:`evaluate`.
    """

    #: The name of the coefficient in messages.
    key = "friction.coefficient"

    def __init__(
        self,
        surface: ContactSurface,
        smoothing: Smoothing,
        law: FrictionLaw | Coefficient | Value | None,
        frictionless: bool = False,
    ) -> None:
        self.surface, self.smoothing, self.frictionless = surface, smoothing, frictionless
        self.law = law_of(law, surface.domain.comm)

    def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
        """The friction bound (k,) at the owned nodes; collective.

        ``pressure`` (k,) is ``-sigma_nu``, and ``slip`` (k,) is the accumulated slip.
        """
        return self.coefficient(slip) * np.abs(self.smoothing.apply(pressure))

    def coefficient(self, slip: FloatArray) -> FloatArray:
        """``mu(x, s)`` (k,) at the nodes; collective."""
        return with_key(self.key, lambda: self.law(self.surface.points, slip))

    def slope(self, slip: FloatArray) -> FloatArray:
        """``d mu/ds`` (k,) at the nodes, by central differences; collective."""
        largest = maximum(self.surface.domain.comm, slip)
        if largest == 0.0:
            return np.zeros_like(slip)
        width = _DIFFERENCE * slip + _DIFFERENCE**2 * largest
        low, high = np.maximum(slip - width, 0.0), slip + width
        return (self.coefficient(high) - self.coefficient(low)) / (high - low)

    @property
    def depends_on_slip(self) -> bool:
        """Whether mu may depend on the slip; it does not if the law says so by ``lipschitz`` 0."""
        return self.law.lipschitz != 0.0

    @property
    def is_coulomb(self) -> bool:
        """Whether the friction bound is (6) and not a user's own."""
        return type(self).evaluate is FrictionBound.evaluate


def law_of(mu: FrictionLaw | Coefficient | Value | None, comm: MPI.Intracomm) -> FrictionLaw:
    """The law of a coefficient mu with its constants; None is no friction."""
    if mu is None:
        return FrictionLaw(lambda points, slip: np.zeros(len(slip)), 0.0, 0.0)
    data: Any = mu.data if isinstance(mu, Value) else mu
    if isinstance(mu, Value) and mu.number is not None:
        number = mu.number
        return FrictionLaw(lambda points, slip: np.full(len(slip), number), number, 0.0)
    if isinstance(mu, Value) and mu.expression is not None:
        lipschitz = None if "s" in mu.expression.names else 0.0
        return FrictionLaw(partial(_of_expression, comm, mu), None, lipschitz)
    if isinstance(data, fem.Constant):
        return FrictionLaw(lambda points, slip: data.value, None, 0.0)
    return data if isinstance(data, FrictionLaw) else FrictionLaw(data)


def _of_expression(
    comm: MPI.Intracomm, mu: Value, points: FloatArray, slip: FloatArray
) -> FloatArray:
    """``mu(x, s)`` (k,) of an expression; collective."""

    def local() -> FloatArray:
        try:
            return mu.at(points.T, s=slip)
        except InputError as error:
            # An iterate may slip farther than the solution, beyond the end of a table.
            if slip.any():
                raise NotConverged(f"the friction coefficient: {error}") from error
            raise

    values = agree(comm, local)
    # An expression that is zero may evaluate to less than zero by rounding.
    least = -_ROUNDING * maximum(comm, np.abs(values))
    agree(comm, lambda: _refuse_negative(values, least, points, slip))
    return np.maximum(values, 0.0)


def _refuse_negative(mu: FloatArray, least: float, points: FloatArray, slip: FloatArray) -> None:
    """Raise InputError, with the point, if a friction coefficient is below ``least``."""
    if not np.any(mu < least):
        return
    worst = int(np.argmin(mu))
    where = [f"{axis} = {place:.6g}" for axis, place in zip(AXES, points[worst], strict=False)]
    raise InputError(
        f"the friction coefficient must not be negative, it is {mu[worst]:g} at "
        f"{', '.join(where)}, s = {slip[worst]:.6g}"
    )


def default_radius(surface: ContactSurface) -> float:
    """The default radius of R; collective."""
    size = surface.domain.facet_diameter(surface.facets)
    return max(_DEFAULT_RADIUS_SHARE * extent_of(surface), _DEFAULT_RADIUS_FACETS * size)


def extent_of(surface: ContactSurface) -> float:
    """About the largest distance between two nodes of Gamma_C; collective.

    One end is the point farthest from the mean of the points, the other end the point farthest from
    the first.  The result is exact for a segment and a rectangle, in every position.
    """
    places: FloatArray = np.concatenate(surface.domain.comm.allgather(surface.points))
    place = places.mean(axis=0)
    for _ in range(2):
        distances = np.linalg.norm(places - place, axis=1)
        place = places[np.argmax(distances)]
    return float(distances.max())
