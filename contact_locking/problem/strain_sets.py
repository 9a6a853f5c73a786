"""The sets of admissible strains; K, which the strain stays in, is the intersection of them all.

A set is given by a linear map L of the strain: it is ``|L eps| <= M`` or, for a scalar ``L eps``,
``L eps <= M``.  Its multiplier y is a tensor or a scalar ``y >= 0``, and its share of the locking
stress is ``L^T y``.  So the work of the multiplier at a strain in the set is ``M |y|`` at most, and
``sum M |y|`` over the sets is an upper bound of the support function of K at the locking stress.

The maps have the norm 1, so that the penalty of a set does not depend on how the set is written:
it is n times the squared distance of the strain to the set, in the norm ``|L eps|``.  That is the
Frobenius norm for the ball, for half spaces and in three dimensions for the deviator.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.fem.compiled import Kept
from contact_locking.fem.spaces import Element
from contact_locking.laws.body import locking_energy, locking_stress, one_sided_energy

StrainMap = Callable[[Expr], Expr]
Sampler = Callable[[], FloatArray]


def _identity(eps: Expr) -> Expr:
    return eps


@dataclass(frozen=True)
class StrainSet(ABC):
    """A closed convex set of strains with 0 in its inside; all functions take and return UFL.

    ``name`` is the name of the set in results.  ``inverse_limit`` is 1/M in the space of strains,
    and 0 where the set does not limit the strain.
    """

    #: Whether multipliers are tensors, and not scalars.
    has_tensors: ClassVar[bool] = True
    #: The density of the penalty for ``L eps``, 1/M and n.
    penalty_energy: ClassVar[staticmethod[[Expr, Expr, Expr], Expr]]

    name: str
    inverse_limit: fem.Function

    @abstractmethod
    def measured(self, eps: Expr) -> Expr:
        """``L eps``, a symmetric (d, d) tensor or a scalar, linear in eps."""

    @abstractmethod
    def stress(self, y: Expr) -> Expr:
        """``L^T y``, the locking stress (d, d) of a multiplier of this set."""

    @abstractmethod
    def size(self, measured: Expr) -> Expr:
        """``|L eps|`` or ``L eps``, which is at most M in the set."""

    def energy(self, eps: Expr, n: Expr) -> Expr:
        """The density of the penalty."""
        return self.penalty_energy(self.measured(eps), self.inverse_limit, n)

    def utilisation(self, eps: Expr) -> Expr:
        """``|L eps|/M`` or ``[L eps]^+/M``: 1 on the boundary of the set, 0 without a limit."""
        used = self.inverse_limit * self.size(self.measured(eps))
        return used if isinstance(self, NormSet) else ufl.max_value(used, 0.0)

    def multipliers(
        self, element: Element, kept: Kept, mesh: dolfinx.mesh.Mesh
    ) -> fem.FunctionSpace:
        """The space of multipliers; collective."""
        shape = element.strain_shape(mesh) if self.has_tensors else ()
        return element.shared_strain_space(kept, mesh, shape)


@dataclass(frozen=True)
class NormSet(StrainSet):
    """``|L eps| <= M`` for a linear map L from symmetric tensors to symmetric tensors.

    ``adjoint`` is ``L^T``.  ``least`` is a lower bound of ``|L eps|/|eps|``, 0 for a map with a
    kernel.
    """

    linear_map: StrainMap = _identity
    adjoint: StrainMap = _identity
    least: float = 1.0

    penalty_energy = staticmethod(locking_energy)

    def multiplier(self, eps: Expr, n: Expr) -> Expr:
        """The multiplier y of the penalty law (23)."""
        return locking_stress(self.measured(eps), self.inverse_limit, n)

    def measured(self, eps: Expr) -> Expr:
        return self.linear_map(eps)

    def stress(self, y: Expr) -> Expr:
        return self.adjoint(y)

    def size(self, measured: Expr) -> Expr:
        return ufl.sqrt(ufl.inner(measured, measured))


@dataclass(frozen=True)
class HalfSpaceSet(StrainSet):
    """``N : eps <= M`` with a symmetric (d, d) tensor N of the norm 1."""

    normal: Expr

    has_tensors = False
    penalty_energy = staticmethod(one_sided_energy)

    def measured(self, eps: Expr) -> Expr:
        return ufl.inner(self.normal, eps)

    def stress(self, y: Expr) -> Expr:
        return y * self.normal

    def size(self, measured: Expr) -> Expr:
        return measured


class Limited:
    """A set of strains on the mesh, whose limit M is read anew by :meth:`refresh`.

    ``sampler`` gives M (k,) at the points, inf where there is no limit, and ``limits`` is M as it
    was read last.  ``strain_set`` is the set in the forms, which ``make`` gives for 1/M.
    """

    def __init__(self, points: Any, sampler: Sampler, make: Callable[..., StrainSet]) -> None:
        self._points, self._sampler = points, sampler
        self._inverse = points.function()
        self.strain_set = make(self._inverse)
        self.refresh()

    def refresh(self) -> None:
        """Take the present limits; collective."""
        self.limits = self._sampler()
        self._points.write(self._inverse, np.reciprocal(self.limits))
