"""What a solver works on, who listens, and what it returns: multipliers and the report."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import dolfinx
import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.fem import compiled
from contact_locking.fem.compiled import Kept
from contact_locking.findings import Finding
from contact_locking.laws.limits import Penalty
from contact_locking.monitor import Monitor
from contact_locking.problem.forms import ProblemData
from contact_locking.problem.rounding import ROUNDING
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.cones import Pair
from contact_locking.solver.settings import Settings


@dataclass(frozen=True)
class ContactForces:
    """Pressure (k,) and ``-sigma_tau`` (k, d) at the owned nodes of one part of Gamma_C.

    ``touches`` (k,) says where the body is in contact; elsewhere the pressure vanishes up to the
    solver's tolerance only.
    """

    pressure: FloatArray
    friction: FloatArray
    touches: BoolArray


@dataclass(frozen=True)
class Multipliers:
    """Z in the space of strains, and the forces on each part of Gamma_C.

    ``parts`` has the multiplier y of each set of strains, and Z is the sum of ``L^T y`` over them.
    If the ball is the only set, its multiplier is Z itself, the same function.
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
        """No stress, and the given forces on Gamma_C; collective."""
        spaces = (item.multipliers(data.element, kept, mesh) for item in data.sets)
        parts = tuple(fem.Function(space) for space in spaces)
        total = parts[0] if data.only_ball else fem.Function(parts[0].function_space)
        total.name = "locking_stress"
        return cls(total, contacts, parts)

    @classmethod
    def zero(cls, system: System) -> Multipliers:
        """No stress and no forces; collective."""
        counts = [len(contact.surface.nodes) for contact in system.data.contacts]
        forces = tuple(
            ContactForces(np.zeros(k), np.zeros((k, system.dim)), np.zeros(k, dtype=bool))
            for k in counts
        )
        return cls.none(system.data, system.kept, system.u.function_space.mesh, forces)

    def add_up(self, data: ProblemData) -> None:
        """Make Z the sum of the shares of all sets of strains; collective."""
        if data.only_ball:
            return
        space = self.locking_stress.function_space
        shares = (item.stress(y) for item, y in zip(data.sets, self.parts, strict=True))
        expression = compiled.interpolation(sum(shares), space)
        self.locking_stress.interpolate(expression)
        self.locking_stress.x.scatter_forward()


# Solves for the same friction bound differ by so many times the rounding in one solution, which the
# margin of the criteria is.
_ROUNDING_OF_SOLVES = 100.0


@dataclass(frozen=True)
class Target:
    """The penalty parameters, and the scales of the problem that starting values are made from.

    ``stiffness`` and ``ellipticity`` are the largest and the smallest eigenvalue of A,
    ``young`` its Young's modulus, ``length`` the extent of the body, ``volume`` its measure and
    ``face`` the measure of a face as long as the body.
    """

    penalty: Penalty
    stiffness: float
    ellipticity: float
    young: float
    length: float
    volume: float
    face: float

    def mean_strain(self, energy: float, displacement: float, tolerance: float) -> float:
        """``sqrt(a(u, u)/(alpha |Omega|))``, or what rounding in ``u`` leaves, if that is larger.

        ``energy`` is ``a(u, u)/2`` and ``displacement`` the largest ``|u|``.
        """
        mean = math.sqrt(2.0 * max(energy, 0.0) / (self.ellipticity * self.volume))
        return max(mean, ROUNDING * displacement / (self.length * tolerance))

    def mean_stress(self, mean_strain: float) -> float:
        """The stress of :meth:`mean_strain`."""
        return math.sqrt(self.stiffness * self.ellipticity) * mean_strain

    def least_bound(self, mean_strain: float) -> float:
        """The L2 norm on Gamma_C below which changes of the friction bound are judged absolutely.

        It is a thousandth of the :meth:`mean_stress` over a face of the body:
        where contact only grazes, relative changes of next to nothing say nothing.
        """
        return 1e-3 * self.mean_stress(mean_strain) * math.sqrt(self.face)


@dataclass
class Counts:
    """What solves have taken: tangents, linear iterations, and updates of the friction bounds."""

    tangents: int = 0
    linear: int = 0
    updates: int = 0

    def add(self, aside: Counts) -> None:
        """Count what auxiliary problems took, whose updates of the bounds do not count."""
        self.tangents += aside.tangents
        self.linear += aside.linear


@dataclass(frozen=True)
class SavedState:
    """A solution of some problem on this mesh, from which another solve may lead on.

    ``displacement`` holds local values, ghosts included, ``travels`` those of the tools, and
    ``penalty`` the penalty parameters.  ``cones`` has the last pair (x, z) of each family of the
    interior point method, None for a family that takes no part; it is empty where these are not
    known.  ``multipliers`` are None where the contacts or the sets of strains were others.
    """

    displacement: FloatArray
    travels: tuple[float, ...]
    penalty: Penalty
    cones: tuple[Pair | None, ...] = ()
    multipliers: Multipliers | None = None


@dataclass(frozen=True)
class Outcome:
    """What a solve has led to, and what it took; displacement and bounds are in the system.

    ``multipliers`` are None where a solve ended before there were any, and ``last`` is the last
    state of the interior point method, None where that did not arrive.  ``friction_change`` is the
    last change of the friction bounds, relative, and ``contraction`` the factor by which their
    fixed point shrank its update, None where there was too little to observe.

    ``reason`` says in words why a solve failed, ``suggestion`` what may help.  ``is_infeasible``
    says that nothing is admissible on this mesh, and ``is_unbalanced`` that no forces balance the
    loads.  ``admissible_factor`` brackets the largest multiple of the prescribed displacements that
    can be followed, if they cannot be.  ``from_saved`` says that a saved state was what the
    solution was reached from.  ``tangents``, ``linear`` and ``updates`` are those of all
    ``stages``.  ``warnings`` say in words where another way was taken than the one asked for.
    """

    multipliers: Multipliers | None = None
    last: SavedState | None = None
    duality_gap: float | None = None
    friction_change: float | None = None
    contraction: float | None = None
    converged: bool = False
    reason: str = ""
    suggestion: str = ""
    is_infeasible: bool = False
    is_unbalanced: bool = False
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

    def counted(self, counts: Counts, stages: Sequence[dict[str, float | int]]) -> Outcome:
        """The same with what it took."""
        return dataclasses.replace(self, **vars(counts), stages=stages)

    def after(self, before: Outcome) -> Outcome:
        """The outcome of a solve that goes on from another one."""
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
    """A stage of a solve that took so many tangents."""
    return {"n": penalty.n, "epsilon": penalty.epsilon, "tangents": tangents}


@dataclass(frozen=True)
class Task:
    """The system that holds the displacement, the target to solve it for, and how to do that.

    ``counts`` is for what the solvers take.
    ``is_unbalanced`` says whether a proof shows that no forces of contact and friction balance the
    loads; it is collective.  Without ``searches`` a solve that fails by the first
    attempt is given up, with a proof that nothing is admissible if there is one.
    """

    system: System
    target: Target
    settings: Settings = field(default_factory=Settings)
    monitor: Monitor = field(default_factory=Monitor)
    counts: Counts = field(default_factory=Counts)
    is_unbalanced: Callable[[], bool] = lambda: False
    searches: bool = True

    def with_settings(self, **changes: Any) -> Task:
        """The same task with other settings."""
        settings = self.settings.model_copy(update=changes)
        return dataclasses.replace(self, settings=settings)

    def aside(self, counts: Counts, target: Target | None = None) -> Task:
        """A silent task for the same system with counts of its own."""
        return dataclasses.replace(
            self, target=target or self.target, monitor=Monitor(), counts=counts
        )

    def least_bound(self) -> float:
        """The norm below which changes of the friction bound are judged absolutely; collective.

        Two solves for nearly the same bound differ by rounding in the displacement, which a small
        strain of a body that moves far makes large.  The criteria permit as much.
        """
        system, tolerance = self.system, self.settings.tolerance
        displacement = system.largest_displacement()
        strain = self.target.mean_strain(system.energy(), 0.0, tolerance)
        rounding = self.target.mean_strain(0.0, displacement, tolerance)
        return self.target.least_bound(max(strain, _ROUNDING_OF_SOLVES * rounding))
