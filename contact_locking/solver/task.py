"""What a solver works on, who listens, and what it returns: multipliers and the report."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import dolfinx
import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.fem import compiled
from contact_locking.fem.compiled import Kept
from contact_locking.findings import Finding
from contact_locking.laws.penalty import Penalty
from contact_locking.monitor import Monitor
from contact_locking.problem.forms import ProblemData
from contact_locking.problem.rounding import ROUNDING
from contact_locking.problem.system import System
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

    @classmethod
    def none(cls, nodes: int, dim: int) -> ContactForces:
        """No forces at so many nodes."""
        return cls(np.zeros(nodes), np.zeros((nodes, dim)), np.zeros(nodes, dtype=bool))


def multiplier_spaces(
    data: ProblemData, kept: Kept, mesh: dolfinx.mesh.Mesh
) -> list[fem.FunctionSpace]:
    """The spaces of the multipliers of the sets of strains; collective."""
    return [item.multipliers(data.element, kept, mesh) for item in data.sets]


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
        spaces: Sequence[fem.FunctionSpace],
        contacts: tuple[ContactForces, ...],
    ) -> Multipliers:
        """No stress, in :func:`multiplier_spaces`, and the given forces on Gamma_C; collective."""
        parts = tuple(fem.Function(space) for space in spaces)
        total = parts[0] if data.only_ball else fem.Function(parts[0].function_space)
        total.name = "locking_stress"
        return cls(total, contacts, parts)

    @classmethod
    def zero(cls, system: System) -> Multipliers:
        """No stress and no forces; collective."""
        data, mesh = system.data, system.u.function_space.mesh
        forces = (ContactForces.none(len(c.surface.nodes), system.dim) for c in data.contacts)
        return cls.none(data, multiplier_spaces(data, system.kept, mesh), tuple(forces))

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


# The points x of a family and their multipliers z.
Pair: TypeAlias = tuple[FloatArray, FloatArray]


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
class LastIterate:
    """Local displacements, ghosts included, travels of tools, and a pair (x, z) for each family.

    A family that takes no part, as all do not where the body is elastic, has None.
    """

    displacement: FloatArray
    travels: tuple[float, ...]
    cones: tuple[Pair | None, ...]


@dataclass(frozen=True)
class Outcome:
    """What a solver has found beside the displacement and the friction bounds in the system.

    ``multipliers`` are None where a solve ended before there were any.
    ``last`` is the last iterate of the interior point method, None where that did not arrive.
    ``friction_change`` is the last change of the friction bounds, relative.  ``contraction`` is the
    factor by which the friction fixed point shrank its update, None where there was too little to
    observe.
    """

    multipliers: Multipliers | None = None
    last: LastIterate | None = None
    duality_gap: float | None = None
    friction_change: float | None = None
    contraction: float | None = None

    def settled(self, change: float, contraction: float | None) -> Outcome:
        """The same after a fixed point of the friction bounds."""
        contraction = self.contraction if contraction is None else contraction
        return dataclasses.replace(self, friction_change=change, contraction=contraction)


@dataclass(frozen=True)
class SolverReport(Outcome):
    """How a solve went, and what it took over all stages; ``reason`` is in words.

    ``is_infeasible`` says that nothing is admissible on this mesh, and ``is_unbalanced`` that no
    forces balance the loads.  ``suggestion`` names the way out of a failure.  ``admissible_factor``
    brackets the largest multiple of the prescribed displacements that can be followed, if they
    cannot be.  ``from_saved`` says that a saved state was what the solution was reached from.
    ``warnings`` say where another way was taken than the one asked for.
    """

    converged: bool = False
    is_infeasible: bool = False
    is_unbalanced: bool = False
    reason: str = ""
    suggestion: str = ""
    tangents: int = 0
    linear: int = 0
    updates: int = 0
    admissible_factor: tuple[float, float] | None = None
    from_saved: bool = False
    stages: Sequence[dict[str, float | int]] = ()
    warnings: Sequence[Finding] = ()

    @classmethod
    def solved(cls, found: Outcome, counts: Counts, **more: Any) -> SolverReport:
        """The report of a solve whose criteria all hold."""
        known = {**vars(found), **vars(counts), **more}
        return cls(**known, converged=True, reason="every criterion held")

    def after(self, before: SolverReport) -> SolverReport:
        """The report of a solve that goes on from another one."""
        counts = {
            name: getattr(self, name) + getattr(before, name)
            for name in ("tangents", "linear", "updates")
        }
        return dataclasses.replace(
            self,
            **counts,
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


@dataclass(frozen=True)
class SavedState:
    """The solution of some problem on this mesh with the penalty parameters ``penalty``.

    ``displacement`` holds local values, ghosts included, and ``travels`` those of the tools.
    ``multipliers`` are None where the contacts or the sets of strains were others.  ``last`` is the
    last iterate that led to this state, if it is known.
    """

    displacement: FloatArray
    travels: tuple[float, ...]
    multipliers: Multipliers | None
    penalty: Penalty
    last: LastIterate | None = None
