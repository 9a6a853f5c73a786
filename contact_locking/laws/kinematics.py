"""How a displacement strains the body: in the plane or in space, or around an axis of revolution.

Forms ask an object of this module for the strain and for the measure of their integrals, so that
the laws and the solvers are the same for all bodies.
"""

from __future__ import annotations

import math
from typing import Any

import ufl
from ufl.core.expr import Expr

from contact_locking.laws.elasticity import AXISYMMETRIC_PAIRS, MANDEL_PAIRS
from contact_locking.laws.elasticity import strain as strain_of


class Kinematics:
    """``eps(u) = sym grad u``: bodies in space, and in the plane per unit of thickness.

    A strain of another kind is a subclass.  Displacements are (d,), and strains symmetric (m, m)
    tensors.  ``axisymmetric`` says that the mesh is the half section of a body of revolution.
    """

    axisymmetric = False

    def strain(self, u: Expr) -> Expr:
        """``eps(u)``, a symmetric (m, m) tensor without unit."""
        return strain_of(u)

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
        flat, hoop = strain_of(u), u[0] / radius
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
