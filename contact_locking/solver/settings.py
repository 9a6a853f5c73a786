"""The settings of a solver."""

from __future__ import annotations

from dataclasses import dataclass, field

from contact_locking.solver.linear.options import UserOptions


@dataclass(frozen=True)
class Settings:
    """The method, its tolerances and limits.

    ``method`` is auto, interior_point or newton.  ``tolerance`` bounds the
    equilibrium residual relative to the forces, and ``friction_tolerance`` the last change of the
    friction bound relative to it.  ``nested`` asks for the fixed point on the bound around whole
    solves.  ``linear`` is auto, direct or iterative.  ``petsc`` holds options that override every
    default, without prefix.
    """

    method: str = "auto"
    tolerance: float = 1e-8
    max_iterations: int = 100
    friction_tolerance: float = 1e-8
    max_friction_updates: int = 100
    nested: bool = False
    linear: str = "auto"
    petsc: UserOptions = field(default_factory=UserOptions)
