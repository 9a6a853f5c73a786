"""What a solver reports, the same for every strategy."""

from __future__ import annotations

from dataclasses import dataclass, field

from contact_locking.solver.last_iterate import LastIterate
from contact_locking.solver.multipliers import Multipliers


@dataclass
class SolverReport:
    """How a solve went.  Counters add up over all stages; ``reason`` is in words.

    ``is_infeasible`` says that nothing is admissible on this mesh.  ``contraction`` is the factor
    by which the friction fixed point shrank its update, None where there was too little to observe;
    ``suggestion`` names the way out of a failure.  ``admissible_factor`` brackets the largest
    multiple of the prescribed displacements that can be followed, if they cannot be.
    ``multipliers`` are set where they are unknowns of the solver; otherwise the laws give them.
    ``last`` is the last iterate of the interior point method, None where that did not arrive.
    ``from_saved`` says that a saved state was what the solution was reached from.  ``warnings`` say
    in words where another way was taken than the one asked for.
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
    last: LastIterate | None = None
    stages: list[dict[str, float | int]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
