"""The laws of the body in UFL: how a displacement strains it, elasticity, and locking.

The operator A of (h1)-(h4) is a matrix that acts on symmetric tensors as Mandel vectors:
``(xx, yy, sqrt(2) xy)`` in 2D and ``(xx, yy, zz, sqrt(2) yz, sqrt(2) xz, sqrt(2) xy)`` in 3D.  With
these square roots the Euclidean norm of the vector equals the Frobenius norm of the tensor, and the
matrix has the eigenvalues of A.  Two dimensions mean plane strain; for plane stress lambda is
another (:func:`plane_stress_lambda`).  Forms ask a :class:`Kinematics` for the strain and for the
measure of their integrals, so that the laws and the solvers are the same in the plane, in space,
and around an axis of revolution.

The limit of the paper is the ball ``|eps| <= M`` with the penalty R_n (23).  A limit
``|L eps| <= M`` with a linear map L has the same penalty of ``L eps``, and a limit ``s <= M`` of a
scalar ``s = N : eps`` has the penalty :func:`one_sided_energy`.  UFL can differentiate each
function without a division by zero: no norm is taken of a quantity that can vanish.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import ufl
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray

MANDEL_PAIRS: dict[int, tuple[tuple[int, int], ...]] = {
    2: ((0, 0), (1, 1), (0, 1)),
    3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)),
}
#: The entries (rr, zz, hoop, sqrt(2) rz) of a body of revolution, whose other entries vanish.
AXISYMMETRIC_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1))
_PAIRS_BY_SIZE = {len(pairs): pairs for pairs in (*MANDEL_PAIRS.values(), AXISYMMETRIC_PAIRS)}


def mandel_factor(i: int, j: int) -> float:
    """1 if i = j, else sqrt(2): the factor of the tensor's entry (i, j) in the Mandel vector."""
    return 1.0 if i == j else math.sqrt(2.0)


def strain(u: Expr) -> Expr:
    """``eps(u) = sym grad u``, a symmetric (d, d) tensor without unit."""
    return ufl.sym(ufl.grad(u))


def isotropic_stress(eps: Expr, lame_lambda: Expr, lame_mu: Expr) -> Expr:
    """``A eps = lambda tr(eps) I + 2 mu eps``, in the unit of the Lame coefficients."""
    return lame_lambda * ufl.tr(eps) * ufl.Identity(eps.ufl_shape[0]) + 2.0 * lame_mu * eps


def anisotropic_stress(eps: Expr, stiffness: Expr) -> Expr:
    """``A eps`` for a Mandel matrix ``A``: (3, 3) in 2D, (6, 6) in 3D, (4, 4) of a revolution."""
    return mandel_product(stiffness, eps)


def mandel_product(matrix: Expr, tensor: Expr) -> Expr:
    """The symmetric tensor whose Mandel vector is a matrix times that of the given tensor."""
    pairs = _PAIRS_BY_SIZE[matrix.ufl_shape[0]]
    return mandel_tensor(ufl.dot(matrix, mandel_vector(tensor, pairs)), tensor.ufl_shape[0])


def mandel_vector(tensor: Expr, pairs: tuple[tuple[int, int], ...] | None = None) -> Expr:
    """The Mandel vector of a symmetric (d, d) tensor.

    ``pairs`` are the entries of the vector, by default all entries.
    """
    pairs = MANDEL_PAIRS[tensor.ufl_shape[0]] if pairs is None else pairs
    return ufl.as_vector([tensor[i, j] * mandel_factor(i, j) for i, j in pairs])


def mandel_tensor(vector: Expr, dim: int) -> Expr:
    """The symmetric (d, d) tensor of a Mandel vector; the inverse of :func:`mandel_vector`."""
    entry: dict[tuple[int, int], Any] = {}
    for k, (i, j) in enumerate(_PAIRS_BY_SIZE[vector.ufl_shape[0]]):
        entry[i, j] = entry[j, i] = vector[k] / mandel_factor(i, j)
    return ufl.as_tensor([[entry.get((i, j), 0.0) for j in range(dim)] for i in range(dim)])


def mandel_values(tensors: FloatArray, pairs: tuple[tuple[int, int], ...]) -> FloatArray:
    """The Mandel vectors (k, s) of symmetric tensors (k, d, d)."""
    return np.stack([tensors[:, i, j] * mandel_factor(i, j) for i, j in pairs], axis=1)


def tensor_values(vectors: FloatArray, pairs: tuple[tuple[int, int], ...], size: int) -> FloatArray:
    """The tensors (k, size, size) of Mandel vectors (k, s)."""
    tensors = np.zeros((len(vectors), size, size))
    for k, (i, j) in enumerate(pairs):
        tensors[:, i, j] = tensors[:, j, i] = vectors[:, k] / mandel_factor(i, j)
    return tensors


def lame_from_young(young: Any, poisson: Any) -> tuple[Any, Any]:
    """``lambda = E nu/((1 + nu)(1 - 2 nu))``, ``mu = E/(2 (1 + nu))``; numbers or arrays."""
    lame_lambda = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    return lame_lambda, young / (2.0 * (1.0 + poisson))


def plane_stress_lambda(lame_lambda: Any, lame_mu: Any) -> Any:
    """``2 lambda mu/(lambda + 2 mu)``: lambda of the plane if ``sigma_zz = 0``; numbers or arrays.

    The strain across the plane is then ``eps_zz = -lambda/(lambda + 2 mu) tr(eps)``.
    """
    return 2.0 * lame_lambda * lame_mu / (lame_lambda + 2.0 * lame_mu)


def isotropic_stiffness(
    lame_lambda: Any, lame_mu: Any, dim: int, pairs: tuple[tuple[int, int], ...] | None = None
) -> FloatArray:
    """``lambda m m^T + 2 mu I`` with ``m`` the Mandel vector of the identity.

    Scalars give one matrix (s, s), arrays of length k give (k, s, s); s = 3 in 2D, 6 in 3D.
    ``pairs`` are the s entries of Mandel vectors, by default all entries of (d, d) tensors.
    """
    pairs = MANDEL_PAIRS[dim] if pairs is None else pairs
    size, identity = len(pairs), np.array([1.0 if i == j else 0.0 for i, j in pairs])
    volumetric = np.multiply.outer(np.asarray(lame_lambda), np.outer(identity, identity))
    return volumetric + 2.0 * np.multiply.outer(np.asarray(lame_mu), np.eye(size))


def mean_young(stiffness: FloatArray, dim: int) -> FloatArray:
    """``max(E, alpha)``, which is positive for every elliptic A.

    E is Young's modulus of the isotropic tensor that is nearest to A in the Frobenius norm (Voigt),
    and alpha the smallest eigenvalue of A.  In the plane E may be negative although A is elliptic.
    ``stiffness`` holds Mandel matrices (k, s, s), and the result is (k,).  For an isotropic A with
    a Poisson's ratio of at least -1/2 the result is the Young's modulus of A.
    """
    # I : A : I = d (2 mu + d lambda), and tr A = (2 mu + d lambda) + 2 mu (s - 1).
    volumetric = stiffness[:, :dim, :dim].sum(axis=(1, 2)) / dim
    trace = np.trace(stiffness, axis1=1, axis2=2)
    lame_mu = 0.5 * (trace - volumetric) / (stiffness.shape[1] - 1)
    young = young_from_lame((volumetric - 2.0 * lame_mu) / dim, lame_mu)
    return np.maximum(young, np.linalg.eigvalsh(stiffness)[:, 0])


def young_from_lame(lame_lambda: Any, lame_mu: Any) -> Any:
    """``E = mu (3 lambda + 2 mu)/(lambda + mu)``; numbers or arrays."""
    return lame_mu * (3.0 * lame_lambda + 2.0 * lame_mu) / (lame_lambda + lame_mu)


def isotropic_eigenvalues(lame_lambda: Any, lame_mu: Any, dim: int) -> tuple[Any, Any]:
    """The eigenvalues of an isotropic A: ``2 mu`` (shear) and ``2 mu + d lambda`` (volume)."""
    return 2.0 * lame_mu, 2.0 * lame_mu + dim * lame_lambda


class Kinematics:
    """``eps(u) = sym grad u``: bodies in space, and in the plane per unit of thickness.

    A strain of another kind is a subclass.  Displacements are (d,), and strains symmetric (m, m)
    tensors.  ``axisymmetric`` says that the mesh is the half section of a body of revolution.
    """

    axisymmetric = False

    def strain(self, u: Expr) -> Expr:
        """``eps(u)``, a symmetric (m, m) tensor without unit."""
        return strain(u)

    def tensor_size(self, dim: int) -> int:
        """The size m of tensors, for a mesh of ``dim`` dimensions."""
        return dim

    def mandel_pairs(self, dim: int) -> tuple[tuple[int, int], ...]:
        """The entries of tensors that can differ from zero, in the order of Mandel vectors."""
        return MANDEL_PAIRS[dim]

    def weighted(self, measure: ufl.Measure) -> ufl.Measure:
        """The measure of the body for a measure of the mesh."""
        return measure


class Revolution(Kinematics):
    """``eps(u) = sym grad u + (u_r/r) e x e``: a body of revolution without torsion.

    The mesh is the half section with the coordinates (r, z) = (x, y).  The hoop strain ``u_r/r`` in
    the circumferential direction e is the third diagonal entry of the (3, 3) tensors, and every
    integral has the factor ``2 pi r``.
    """

    axisymmetric = True

    def strain(self, u: Expr) -> Expr:
        radius = ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(u))[0]
        flat, hoop = strain(u), u[0] / radius
        return ufl.as_tensor(
            [[flat[0, 0], flat[0, 1], 0.0], [flat[1, 0], flat[1, 1], 0.0], [0.0, 0.0, hoop]]
        )

    def tensor_size(self, dim: int) -> int:
        return 3

    def mandel_pairs(self, dim: int) -> tuple[tuple[int, int], ...]:
        return AXISYMMETRIC_PAIRS

    def weighted(self, measure: ufl.Measure) -> ufl.Measure:
        radius = ufl.SpatialCoordinate(measure.ufl_domain())[0]
        return WeightedMeasure(measure, 2.0 * math.pi * radius)


STRAIGHT, REVOLUTION = Kinematics(), Revolution()


class WeightedMeasure(ufl.Measure):
    """``f -> int f w``: a measure with a density w."""

    __slots__ = ("_density", "_plain")

    def __init__(self, plain: ufl.Measure, density: Expr) -> None:
        super().__init__(
            plain.integral_type(),
            domain=plain.ufl_domain(),
            subdomain_id=plain.subdomain_id(),
            metadata=plain.metadata(),
            subdomain_data=plain.subdomain_data(),
        )
        self._plain, self._density = plain, density

    def __rmul__(self, integrand: Any) -> ufl.Form:
        return (self._density * integrand) * self._plain

    def reconstruct(self, **changes: Any) -> WeightedMeasure:
        """The same density on another part of the domain, or with other metadata."""
        return WeightedMeasure(self._plain.reconstruct(**changes), self._density)


def positive_part(a: Expr) -> Expr:
    """``[a]^+ = max(a, 0)`` of a scalar, with derivative 0 at ``a = 0``."""
    return ufl.max_value(a, 0.0)


def squared_norm(a: Expr) -> Expr:
    """``|a|^2 = a : a``, the squared Euclidean (vectors) or Frobenius (tensors) norm."""
    return ufl.inner(a, a)


def unit_ball_excess(a: Expr, inverse_radius: Expr) -> Expr:
    """``e(a) = 1 - 1/max(|a|/M, 1)``: the share of ``a`` outside the ball ``|.| <= M``.

    ``e(a) a = a - P(a)`` with the projection ``P`` onto the ball, and ``e(a) |a| = [|a| - M]^+``.
    The argument is ``1/M``, so that the number 0 stands for an infinite radius and gives exactly 0.
    The maximum is taken of squares, so that neither the value nor its derivative divides by zero
    at ``a = 0``.
    """
    return 1.0 - 1.0 / ufl.sqrt(ufl.max_value(inverse_radius**2 * squared_norm(a), 1.0))


def normal_part(v: Expr, normal: Expr) -> Expr:
    """``v_nu = v . nu``, a scalar."""
    return ufl.inner(v, normal)


def tangential_part(v: Expr, normal: Expr) -> Expr:
    """``v_tau = v - (v . nu) nu``, a vector."""
    return v - normal_part(v, normal) * normal


def locking_stress(eps: Expr, inverse_limit: Expr, n: Expr) -> Expr:
    """``R_n(eps) = 2 n [|eps| - M]^+ eps/|eps| = 2 n (1 - 1/max(|eps|/M, 1)) eps`` (23).

    ``inverse_limit`` is ``1/M``, and 0 where the body does not lock; ``n`` has the unit of a
    stress. The result is a (d, d) tensor, exactly zero where ``|eps| <= M``.
    """
    return 2.0 * n * unit_ball_excess(eps, inverse_limit) * eps


def locking_energy(eps: Expr, inverse_limit: Expr, n: Expr) -> Expr:
    """``n ([|eps| - M]^+)^2``, the density whose derivative is :func:`locking_stress`."""
    return n * unit_ball_excess(eps, inverse_limit) ** 2 * squared_norm(eps)


def one_sided_energy(s: Expr, inverse_limit: Expr, n: Expr) -> Expr:
    """``n ([s - M]^+)^2``, the density of the penalty of a limit ``s <= M``."""
    return n * _one_sided_excess(s, inverse_limit) ** 2


def _one_sided_excess(s: Expr, inverse_limit: Expr) -> Expr:
    """``[s - M]^+`` as ``(1 - 1/max(s/M, 1)) [s]^+``, which takes 1/M."""
    return (1.0 - 1.0 / ufl.max_value(inverse_limit * s, 1.0)) * positive_part(s)


def deviator(eps: Expr) -> Expr:
    """``L eps = eps - t tr(eps) I`` with ``|L eps|^2 = |eps|^2 - tr(eps)^2/3``.

    In three dimensions this is the deviator.  In two dimensions ``|L eps|`` is the norm of the
    deviator of the three-dimensional strain with ``eps_zz = 0``, as in plane strain.
    """
    dim = eps.ufl_shape[0]
    # 2 t - d t^2 = 1/3.
    share = (1.0 - math.sqrt(1.0 - dim / 3.0)) / dim
    return eps - share * ufl.tr(eps) * ufl.Identity(dim)


def weighted(eps: Expr, matrix: Expr) -> Expr:
    """``C eps`` for a matrix C in Mandel's notation, as a symmetric (d, d) tensor."""
    return mandel_product(matrix, eps)
