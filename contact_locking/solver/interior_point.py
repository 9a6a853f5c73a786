"""A primal-dual interior point method for the contact problem, for any n up to infinity.

For a given friction bound the problem is a second-order cone programme.  Its cones are small and
many, one per cell and two per node of Gamma_C, so each is eliminated where it stands and what is
left is an elasticity system in the displacement.  Scaling: Nesterov and Todd,
doi:10.1287/moor.22.1.1; predictor and corrector: Mehrotra, doi:10.1137/0802028.  The friction
bound takes part in every step by Newton's method (:mod:`bound_step`), so that the non-local problem
costs few back-substitutions more than one with a known bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.contacts import FrictionBound
from contact_locking.errors import Infeasible, NotConverged
from contact_locking.progress import Monitor
from contact_locking.solver.blocks import ContactBlock, FrictionBlock, LockingBlock
from contact_locking.solver.bound_step import BoundStep
from contact_locking.solver.cone_point import ConePoint, Direction
from contact_locking.solver.cone_system import ConeSystem
from contact_locking.solver.cones import Lorentz
from contact_locking.solver.farkas import excluded_factor
from contact_locking.solver.linear import LINEAR_FAILURE
from contact_locking.solver.measures import Measures
from contact_locking.solver.multipliers import Multipliers
from contact_locking.solver.report import Settings, SolverReport
from contact_locking.solver.start import ElasticStart
from contact_locking.solver.target import Target
from contact_locking.system import PenalisedSystem

FloatArray = npt.NDArray[np.float64]

# How far a step goes towards the boundary of the cones.
_TO_BOUNDARY = 0.97
# Steps that are shorter lead nowhere.
_SHORTEST = 1e-8
# Mehrotra's second-order terms are taken in full where the predictor goes this far, and in
# proportion where it does not: terms of a direction that hardly leads anywhere mislead.
_TRUSTED = 1.0 / 3.0
# Recentrings (Gondzio's correctors) after each predictor and corrector: at most this many, while
# the step is shorter than this, reaching this much farther, kept if the step grows by this factor.
_RECENTRINGS = 3
_LONG_ENOUGH = 0.95
_REACH = 0.4
_GAIN = 1.01
# The duality gap, relative to the energy, at which the iteration stops, and the share of it that is
# aimed at.  Rounding in nearly singular cones leaves about 1e-9.
_GAP_TOLERANCE = 1e-8
_GAP_LEFT = 0.5
# A gap that has become smaller may grow by this factor in a step.
_GAP_BACK = 10.0
# The gap may not be a smaller share than this of the other residuals.
_GAP_AHEAD = 1e-2
# The share of the duality gap that a linear solve may leave as residual, but for this share of the
# tolerance: sharper solves save a tangent or two and cost more than these.
_LINEAR_SHARE, _SHARPEST = 0.3, 0.03
# It leaves no more than this share of the forces.  At the beginning, when the residual is a hundred
# times as large as they are, solves that left more led to short steps, at n = inf to five tangents
# more or nowhere.
_MOST_LEFT = 0.03
# A step that leaves more than this share of the distance between the friction bound and mu |R p|
# has not brought them closer, unless they are as close as the other number, relative to the bound.
_CLOSER, _CLOSE = 0.5, 1e-6
# Multipliers that have grown by this factor while the laws stay violated may prove that nothing is
# admissible.
_DIVERGED = 1e2
# Next to the work of locking the elastic energy can be nothing; this share of it then stands for
# the energy that the duality gap is compared with.
_LOCKING_SHARE = 1e-2
# Energies are judged against this share of that at the start if they are smaller.
_LEAST = 1e-10
# A bound is kept above this share of the largest, so that the friction cones have an inside.
_LEAST_BOUND = 1e-12
# The start: complementarity against the density of the elastic energy.
_START_LEVEL = 0.1


@dataclass(frozen=True)
class Approach:
    """What a solve that fails is tried again with.

    ``opening`` is the least opening of contact at the start against the strain times the length.
    ``trusts_newton`` leaves the friction bound where a step brought it, if that came closer.
    """

    opening: float
    trusts_newton: bool


# The first is faster on fine meshes; the second finds solutions where friction changes much with
# the slip.
APPROACHES = (Approach(0.1, trusts_newton=True), Approach(100.0, trusts_newton=False))


class InteriorPoint:
    """One solve from a cold start: a previous case, on the boundary of its cones, is no better.

    At most 2 of some 20 tangents are saved by the displacement of the next smaller n or mu.
    ``bound_moves`` lets the friction bound follow the pressure; otherwise it stays as it is.
    """

    def __init__(
        self,
        system: PenalisedSystem,
        target: Target,
        settings: Settings,
        monitor: Monitor,
        bound_moves: bool = True,
    ) -> None:
        self.approach = APPROACHES[0]
        self._bound_moves = bound_moves
        self._system, self._target = system, target
        self._settings, self._monitor = settings, monitor
        self._lorentz = Lorentz(system.comm)
        self._cones = cones = ConeSystem(system, settings, target.stiffness)
        self._unstrained = np.zeros((cones.rows, len(cones.limit)))
        self._point = ConePoint(cones, target.length, self._locking_block(self._unstrained))
        self._friction_change = 0.0
        #: Whether the elastic displacement alone is the solution.
        self.is_elastic = False
        self._first: tuple[float, float] | None = None

    def solve(self, report: SolverReport) -> Multipliers:
        """Iterate to the tolerances; raises NotConverged, the best iterate left in place."""
        # What is no number is found where steps and residuals are judged.
        with np.errstate(all="ignore"):
            try:
                return self._iterate_to_the_end(report)
            finally:
                report.friction_change = self._friction_change

    def _iterate_to_the_end(self, report: SolverReport) -> Multipliers:
        monitor, settings = self._monitor, self._settings
        self._friction_change, self._first = 0.0, None
        try:
            self._start(report)
        except PETSc.Error as error:
            raise NotConverged(LINEAR_FAILURE) from error
        finally:
            report.linear += self._cones.take_iterations()
        if self.is_elastic:
            unbalanced = self._cones.residual_norm(self._unstrained, None, None)
            monitor.iteration(0, unbalanced / (self._cones.force_scale or 1.0))
            report.duality_gap = 0.0
            return self.multipliers()
        limit = settings.max_iterations
        for iteration in range(limit + 1):
            measures = self._measured = self._measure()
            monitor.iteration(iteration, measures.worst())
            if not np.isfinite(measures.equilibrium + measures.gap):
                raise NotConverged("the interior point iteration lost its digits")
            if measures.reached(settings, _GAP_TOLERANCE):
                break
            self._stop_if_infeasible(measures)
            if iteration == limit:
                self.require_feasible()
                raise NotConverged(
                    f"{limit} interior point iterations did not suffice ({measures})"
                )
            if not self._iterate(report):
                self.require_feasible()
                raise NotConverged(f"the interior point step vanished ({measures})")
        report.duality_gap = measures.gap
        return self.multipliers()

    @property
    def direct(self) -> PETSc.KSP | None:
        """What factorised the tangents, for those of Newton's method, until this is destroyed."""
        return self._cones.direct

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._cones.destroy()

    def _start(self, report: SolverReport) -> None:
        """Elastic displacements are the solution, or give the place to start around."""
        cones, system, target = self._cones, self._system, self._target
        rubs = system.bound is not None and not system.bound.frictionless
        elastic = ElasticStart(cones, target, self._settings.tolerance, sticks=rubs)
        report.tangents += 1
        is_admissible = elastic.solve()
        # A bound that stands still holds what it holds without any pressure, too.
        self.is_elastic = is_admissible and (self._bound_moves or not self._has_bound())
        energy = target.ellipticity * elastic.strain**2
        self._least_energy = _LEAST * energy * target.volume
        self._least_force = self._least_energy / ((elastic.strain or 1.0) * target.length)
        if self.is_elastic:
            if system.bound is not None:
                system.bound.values = np.zeros_like(system.bound.values)
            return
        size = elastic.retreat()
        locking = self._locking_block(cones.strains(system.u.x.array))
        level = _START_LEVEL * energy
        locking.start(level)
        contact = friction = None
        if system.bound is not None:
            least = self.approach.opening * size * target.length
            opening = cones.node_gap - cones.normal_displacements(system.u.x.array)
            contact = ContactBlock(opening, cones.node_weights, target.epsilon, least)
            contact.start(level * target.length)
            friction = self._start_friction(system.bound, contact.z, least)
        self._point = ConePoint(cones, target.length, locking, contact, friction)

    def _has_bound(self) -> bool:
        """Whether friction has a bound that is not zero everywhere; collective."""
        bound = self._system.bound
        return bound is not None and bound.norm(bound.values) > 0.0

    def _start_friction(
        self, bound: FrictionBound, pressure: FloatArray, least: float
    ) -> FrictionBlock | None:
        if bound.frictionless:
            return None
        cones = self._cones
        if self._bound_moves:
            bound.values = self._new_bound(bound, pressure)
        # A bound that is nothing leaves no friction to account for.
        if bound.norm(bound.values) == 0.0:
            return None
        slips, values = cones.slips(self._system.u.x.array), bound.values[cones.active]
        regularisation = self._target.regularisation
        least = max(least, regularisation)
        return FrictionBlock(
            self._lorentz, slips, cones.node_weights, regularisation, values, least
        )

    def _locking_block(self, strain: FloatArray) -> LockingBlock:
        cones = self._cones
        compliance = 0.5 / self._target.n
        return LockingBlock(self._lorentz, strain, cones.limit, cones.volumes, compliance)

    def _iterate(self, report: SolverReport) -> bool:
        """Take a step; False if there is none to take; collective."""
        point = self._point
        if point.friction is not None:
            point.friction.bound_step[:] = 0.0
        try:
            point.linearise()
            report.tangents += 1
            affine = self._direction(0.0, None)
            t = min(1.0, point.longest_step(affine))
            before = point.mean_product()
            centring = min(1.0, max(point.mean_product_after(t, affine) / before, 0.0)) ** 3
            step, t = self._combined(affine, t, self._limited(centring) * before)
        except PETSc.Error as error:
            raise NotConverged(LINEAR_FAILURE) from error
        finally:
            report.linear += self._cones.take_iterations()
        if not t > _SHORTEST:
            return False
        point.advance(t, step)
        if self._moving is not None:
            self._follow(*self._moving)
            report.friction += 1
        return True

    @property
    def _moving(self) -> tuple[FrictionBound, ContactBlock, FrictionBlock] | None:
        """What takes part where the friction bound follows the pressure."""
        bound, point = self._system.bound, self._point
        if bound is None or point.contact is None or point.friction is None:
            return None
        return (bound, point.contact, point.friction) if self._bound_moves else None

    def _follow(self, bound: FrictionBound, contact: ContactBlock, friction: FrictionBlock) -> None:
        """Note how far the step left the bound from ``mu |R p|``; collective.

        Where it came hardly closer the bound is set to that: the linearisation fails where slips
        stop, start or turn round.
        """
        cones = self._cones
        wanted = self._new_bound(bound, contact.z)
        used = wanted.copy()
        used[cones.active] = friction.bound
        size = max(bound.norm(wanted), self._target.least_bound(cones.energy, cones.dim))
        before = self._friction_change
        self._friction_change = bound.norm(wanted - used) / size if size > 0.0 else 0.0
        bound.values = used
        came_closer = self._friction_change <= max(_CLOSER * before, _CLOSE)
        if not (came_closer and self.approach.trusts_newton):
            bound.values = wanted
            friction.set_bound(wanted[cones.active])

    def _combined(self, affine: Direction, t: float, target: float) -> tuple[Direction, float]:
        """The step to take and its length: corrected, with the bound moved along, and recentred.

        Everything here uses the factorisation that the predictor ``affine`` of length ``t`` has.
        """
        point = self._point
        corrections = point.corrections(affine, min(1.0, t / _TRUSTED))
        bound_step = None
        if self._moving is not None:
            bound_step = BoundStep(point, self._moving[0], _MOST_LEFT)
        best = self._direction(target, corrections)
        best = self._adapted(bound_step, target, corrections, best)
        t = self._length(best)
        recentred = False
        for _ in range(_RECENTRINGS):
            if t >= _LONG_ENOUGH:
                break
            trial = point.recentred(corrections, min(1.0, t + _REACH), best, target)
            candidate = self._direction(target, trial)
            longer = self._length(candidate)
            if longer < _GAIN * t:
                break
            best, corrections, t, recentred = candidate, trial, longer, True
        if recentred:
            best = self._adapted(bound_step, target, corrections, best)
            t = self._length(best)
        return best, t

    def _adapted(
        self,
        bound_step: BoundStep | None,
        target: float,
        corrections: list[Any],
        direction: Direction,
    ) -> Direction:
        """The direction with the step of the bound that agrees with it; collective."""
        if bound_step is None:
            return direction
        steps = direction[1]
        bound_step.adapt(steps[1][1], steps[2][0][1 : 1 + self._cones.dim])
        return self._direction(target, corrections)

    def _direction(self, target: float, corrections: list[Any] | None) -> Direction:
        """A linear solve may leave a share of what the iteration has not yet achieved."""
        accuracy = max(_LINEAR_SHARE * self._measured.gap, _SHARPEST * self._settings.tolerance)
        return self._point.direction(target, corrections, min(accuracy, _MOST_LEFT))

    def _length(self, direction: Direction) -> float:
        return min(1.0, _TO_BOUNDARY * self._point.longest_step(direction))

    def _limited(self, centring: float) -> float:
        """Keep the complementarity from running ahead of equilibrium, and from vanishing.

        Products that are much smaller than the residuals block every step, and products below the
        tolerance only lose digits.
        """
        now = self._measured
        if now.gap < _GAP_AHEAD * now.equilibrium:
            return 1.0
        return max(centring, min(_GAP_BACK, _GAP_LEFT * _GAP_TOLERANCE / now.gap))

    def _stop_if_infeasible(self, measures: Measures) -> None:
        """Raise Infeasible if multipliers that grow, while laws stay violated, prove it."""
        if self._target.epsilon > 0.0 and math.isfinite(self._target.n):
            return
        size = self._point.largest_multiplier()
        if self._first is None:
            self._first = size, measures.primal
        first_size, first_primal = self._first
        if size > _DIVERGED * first_size and measures.primal > 0.01 * first_primal:
            self._first = size, first_primal
            self.require_feasible()

    def require_feasible(self) -> None:
        """Raise Infeasible if the multipliers prove that nothing is admissible; collective."""
        factor = excluded_factor(self._point, self._target)
        if factor is not None:
            raise Infeasible(
                "infeasible: no displacement of this mesh within the locking limit and the gap "
                "follows the prescribed values; " + self._cones.describe_excess(self._point.strain),
                factor,
            )

    def _measure(self) -> Measures:
        """Look at the iterate and judge it; collective."""
        cones, point, target = self._cones, self._point, self._target
        point.visit()
        tolerance = self._settings.tolerance
        strain = target.mean_strain(cones.energy, cones.largest_displacement(), tolerance)
        energy = 0.5 * target.ellipticity * strain**2 * target.volume
        energy = max(energy, _LOCKING_SHARE * point.locking_work())
        return Measures(
            point.equilibrium_residual() / max(cones.force_scale, self._least_force),
            point.primal_residual(strain * target.length),
            point.total_product() / max(energy, self._least_energy),
            self._friction_change,
        )

    def multipliers(self) -> Multipliers:
        """Those of the present iterate; collective."""
        if self.is_elastic:
            return self._cones.multipliers(self._unstrained, None, None, None)
        return self._point.multipliers(self._target.young)

    def _new_bound(self, bound: FrictionBound, pressure: FloatArray) -> FloatArray:
        """``mu |R p|``, kept positive so that the friction cones have an inside; collective."""
        new = bound.evaluate(self._cones.at_all_nodes(pressure))
        largest = float(np.max(new, initial=0.0))
        return np.maximum(new, _LEAST_BOUND * self._cones.comm.allreduce(largest, op=MPI.MAX))
