"""What a solver is told and what it reports; the same for every strategy."""

from __future__ import annotations

from dataclasses import dataclass, field

from contact_locking.solver.multipliers import Multipliers
from contact_locking.solver.options import UserOptions


@dataclass(frozen=True)
class Settings:
    """Tolerances and limits.

    ``tolerance`` bounds the equilibrium residual relative to the forces, ``friction_tolerance``
    the last change of the friction bound relative to it; ``nested`` asks for the fixed point on
    the bound around whole solves; ``linear`` is auto, direct or iterative; ``petsc`` holds options
    that override every default, without prefix.
    """

    tolerance: float = 1e-8
    max_iterations: int = 100
    friction_tolerance: float = 1e-8
    max_friction_updates: int = 100
    nested: bool = False
    linear: str = "auto"
    petsc: UserOptions = field(default_factory=UserOptions)


@dataclass
class SolverReport:
    """How a solve went.  Counters add up over all stages; ``reason`` is in words.

    ``is_infeasible`` says that nothing is admissible on this mesh.  ``contraction`` is the factor
    by which the friction fixed point shrank its update, None where there was too little to observe;
    ``suggestion`` names the way out of a failure.  ``admissible_factor`` brackets the largest
    multiple of the prescribed displacements that can be followed, if they cannot be.
    ``multipliers`` are set where they are unknowns of the solver; otherwise the laws give them.
    ``from_saved`` says that a saved state was what the solution was reached from.
    """

    converged: bool = False
    is_infeasible: bool = False
    reason: str = ""
    suggestion: str = ""
    tangents: int = 0
    linear: int = 0
    friction: int = 0
    contraction: float | None = None
    friction_change: float | None = None
    duality_gap: float | None = None
    admissible_factor: tuple[float, float] | None = None
    multipliers: Multipliers | None = None
    from_saved: bool = False
    stages: list[dict[str, float | int]] = field(default_factory=list)
