"""Strains that are not elastic: the stress and the energy of the body without any displacement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.problem.points import Points


@dataclass(frozen=True)
class Eigenstrain:
    """``sigma = A (eps - eps_0)``: ``stress`` is ``-A eps_0``, ``energy`` is ``A eps_0 : eps_0/2``.

    ``values`` has eps_0 at the points of the strains.  Both are homogeneous in the values, of the
    degrees 1 and 2, unless the stress itself was given.
    """

    values: fem.Function
    stress: Expr
    energy: Expr

    @classmethod
    def in_space(
        cls, points: Points, linear: Callable[[Expr], Expr], size: int, across: bool
    ) -> Eigenstrain:
        """eps_0 as (3, 3) tensors for a body whose tensors have the given size; collective.

        With ``across`` the strain across the plane of a body in plane strain counts: the law
        ``linear`` then maps tensors of space to those of space.
        """
        values = points.function((3, 3))
        counted: Expr = values
        if size == 2 and not across:
            counted = ufl.as_tensor([[values[i, j] for j in range(2)] for i in range(2)])
        stress = linear(counted)
        part = ufl.as_tensor([[-stress[i, j] for j in range(size)] for i in range(size)])
        return cls(values, part, 0.5 * ufl.inner(stress, counted))

    @classmethod
    def of_stress(cls, points: Points, linear: Callable[[Expr], Expr], stress: Expr) -> Eigenstrain:
        """eps_0 for the stress without strain, whose values the caller sets; collective."""
        values = points.function(stress.ufl_shape)
        return cls(values, stress, 0.5 * ufl.inner(linear(values), values))

    def of_body(self, size: int) -> Expr:
        """eps_0 as a (size, size) tensor of the strains of the body."""
        return ufl.as_tensor([[self.values[i, j] for j in range(size)] for i in range(size)])

    def across(self, points: Points) -> FloatArray:
        """``eps_0,zz`` (k,) at the points, for values in space."""
        return points.values(self.values)[:, 2, 2]
