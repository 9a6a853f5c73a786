"""The input of a solver, a :class:`Task`, and its result, an :class:`Outcome`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import dolfinx
import numpy as np
from dolfinx import fem
from mpi4py import MPI

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.fem import compiled
from contact_locking.fem.compiled import Kept
from contact_locking.findings import Finding
from contact_locking.laws.limits import Penalty
from contact_locking.parallel import maximum
from contact_locking.problem.forms import ProblemData
from contact_locking.problem.rounding import ROUNDING
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.cones import Pair
from contact_locking.solver.monitor import Monitor
from contact_locking.solver.settings import Settings

_NEAR = 1e-3


@dataclass(frozen=True)
class ContactForces:
    """Pressure (k,) and ``-sigma_tau`` (k, d) at the owned nodes of one part of Gamma_C.

    ``touches`` (k,) marks the nodes in contact; at the others the pressure is zero up to the
    solver's tolerance.
    """

    pressure: FloatArray
    friction: FloatArray
    touches: BoolArray

    def is_near(self, other: ContactForces, comm: MPI.Intracomm) -> bool:
        """Whether forces differ by at most 1e-3 of the largest pressure; collective."""
        change = np.column_stack([self.pressure - other.pressure, self.friction - other.friction])
        return maximum(comm, np.abs(change)) <= _NEAR * maximum(comm, self.pressure)


@dataclass(frozen=True)
class Multipliers:
    """The locking stress Z in the space of strains, and the forces on each part of Gamma_C.

    ``parts`` are the multipliers y of the sets of strains, and Z is the sum of ``L^T y`` over them.
    If the ball is the only set, its multiplier and Z are the same function.
    """

    locking_stress: fem.Function
    contacts: tuple[ContactForces, ...]
    parts: tuple[fem.Function, ...]

    @classmethod
    def none(
        cls,
        data: ProblemData,
        kept: Kept,
        mesh: dolfinx.mesh.Mesh,
        contacts: tuple[ContactForces, ...],
    ) -> Multipliers:
        """Zero stress, and these forces on Gamma_C; collective."""
        spaces = (law.multipliers(data.element, kept, mesh) for law in data.sets)
        parts = tuple(fem.Function(space) for space in spaces)
        total = parts[0] if data.only_ball else fem.Function(parts[0].function_space)
        total.name = "locking_stress"
        return cls(total, contacts, parts)

    @classmethod
    def zero(cls, system: System) -> Multipliers:
        """Zero stress and zero forces; collective."""
        counts = [len(contact.surface.nodes) for contact in system.data.contacts]
        forces = tuple(
            ContactForces(np.zeros(k), np.zeros((k, system.dim)), np.zeros(k, dtype=bool))
            for k in counts
        )
        return cls.none(system.data, system.kept, system.u.function_space.mesh, forces)

    def add_up(self, data: ProblemData) -> None:
        """Compute Z, the sum of the stresses of all sets of strains; collective."""
        if data.only_ball:
            return
        space = self.locking_stress.function_space
        stresses = (law.stress(y) for law, y in zip(data.sets, self.parts, strict=True))
        expression = compiled.interpolation(sum(stresses), space)
        self.locking_stress.interpolate(expression)
        self.locking_stress.x.scatter_forward()


@dataclass(frozen=True)
class Target:
    """The penalty parameters to solve for, and the scales of the problem.

    - ``stiffness``, ``ellipticity``, ``young``: the largest and smallest eigenvalue of A, and E
    - ``length``, ``volume``: the extent and the measure of the body
    - ``face``: the measure of a face as long as the body
    """

    penalty: Penalty
    stiffness: float
    ellipticity: float
    young: float
    length: float
    volume: float
    face: float

    def mean_strain(self, energy: float, displacement: float, tolerance: float) -> float:
        """``sqrt(a(u, u)/(alpha |Omega|))``, at least the strain that rounding in ``u`` makes.

        ``energy`` is ``a(u, u)/2`` and ``displacement`` the largest ``|u|``.
        """
        mean = math.sqrt(2.0 * max(energy, 0.0) / (self.ellipticity * self.volume))
        return max(mean, ROUNDING * displacement / (self.length * tolerance))

    def mean_stress(self, mean_strain: float) -> float:
        """The stress of :meth:`mean_strain`."""
        return math.sqrt(self.stiffness * self.ellipticity) * mean_strain

    def least_bound(self, mean_strain: float) -> float:
        """The L2 norm on Gamma_C below which changes of the friction bound are judged absolutely.

        It is that of a thousandth of the :meth:`mean_stress` on a face of the body.  Where contact
        hardly presses, relative changes mean nothing.
        """
        return 1e-3 * self.mean_stress(mean_strain) * math.sqrt(self.face)


@dataclass
class Counts:
    """The cost of solves: tangents, linear iterations, and updates of the friction bounds."""

    tangents: int = 0
    linear: int = 0
    updates: int = 0

    def add(self, aside: Counts) -> None:
        """Add the cost of auxiliary problems, whose updates of the bounds do not count."""
        self.tangents += aside.tangents
        self.linear += aside.linear


@dataclass(frozen=True)
class SavedState:
    """A solution on this mesh, perhaps of other data, that another solve may start from.

    - ``displacement``: local values, ghosts included
    - ``travels``: of the pushed foundations
    - ``penalty``: the penalty parameters that it was solved for
    - ``cones``: (x, z) of each family of the interior point method, None for an inactive family;
      empty if unknown
    - ``multipliers``: None if contacts or sets of strains differ from the present ones
    """

    displacement: FloatArray
    travels: tuple[float, ...]
    penalty: Penalty
    cones: tuple[Pair | None, ...] = ()
    multipliers: Multipliers | None = None


@dataclass(frozen=True)
class Outcome:
    """The result of a solve and its cost; the system has the displacement and the bounds.

    - ``multipliers``: None if the solve ended before there were any
    - ``last``: the last state of the interior point method, None if it failed
    - ``friction_change``: the last relative change of the friction bounds
    - ``contraction``: the factor of their fixed point iteration, None if unknown
    - ``reason``, ``suggestion``: why the solve ended, and what may help, in words
    - ``failure``: the code of a failure; solver.infeasible and solver.unheld are proved
    - ``admissible_factor``: bounds of the largest possible share of the prescribed displacements
    - ``from_saved``: whether the solution was reached from a saved state
    - ``tangents``, ``linear``, ``updates``: the cost of all ``stages``
    - ``warnings``: where the solver deviated from the settings
    """

    multipliers: Multipliers | None = None
    last: SavedState | None = None
    duality_gap: float | None = None
    friction_change: float | None = None
    contraction: float | None = None
    converged: bool = False
    reason: str = ""
    suggestion: str = ""
    failure: str = ""
    admissible_factor: tuple[float, float] | None = None
    from_saved: bool = False
    tangents: int = 0
    linear: int = 0
    updates: int = 0
    stages: Sequence[dict[str, float | int]] = ()
    warnings: Sequence[Finding] = ()

    @classmethod
    def solved(cls, multipliers: Multipliers, **others: Any) -> Outcome:
        """A solve whose criteria all hold."""
        return cls(multipliers, **others, converged=True, reason="every criterion held")

    def with_counts(self, counts: Counts, stages: Sequence[dict[str, float | int]]) -> Outcome:
        """The outcome with its cost."""
        return dataclasses.replace(self, **vars(counts), stages=stages)

    def after(self, before: Outcome) -> Outcome:
        """The outcome of a solve that started from the outcome ``before``; costs add up."""
        return dataclasses.replace(
            self,
            tangents=self.tangents + before.tangents,
            linear=self.linear + before.linear,
            updates=self.updates + before.updates,
            contraction=self.contraction or before.contraction,
            from_saved=before.from_saved,
            stages=[*before.stages, *self.stages],
            warnings=[*before.warnings, *self.warnings],
        )


def stage_of(penalty: Penalty, tangents: int) -> dict[str, float | int]:
    """A stage of a solve with its number of tangents, for summary.json."""
    return {"n": penalty.n, "epsilon": penalty.epsilon, "tangents": tangents}


@dataclass(frozen=True)
class Task:
    """A solve to do: the system with its displacement, the target, and the settings.

    - ``monitor``, ``counts``: receive the progress and the cost of the solve
    - ``is_unbalanced``: proves that no forces balance the loads, if it can; collective
    - ``searches``: whether to go on after a failed first attempt
    """

    system: System
    target: Target
    settings: Settings = field(default_factory=Settings)
    monitor: Monitor = field(default_factory=Monitor)
    counts: Counts = field(default_factory=Counts)
    is_unbalanced: Callable[[], bool] = lambda: False
    searches: bool = True

    def aside(self, counts: Counts, target: Target | None = None) -> Task:
        """The same task, or one with another target, without messages and with these counts."""
        return dataclasses.replace(
            self, target=target or self.target, monitor=Monitor(), counts=counts
        )
