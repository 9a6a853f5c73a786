"""A primal-dual interior point method for the contact problem, for any n up to infinity.

For a given friction bound the problem is a second-order cone programme.  Its cones are small and
many, one per cell and two per node of Gamma_C, so each is eliminated where it stands and what is
left is an elasticity system in the displacement.  Scaling: Nesterov and Todd,
doi:10.1287/moor.22.1.1; predictor and corrector: Mehrotra, doi:10.1137/0802028.  The friction
bound follows the pressure once per iteration, so that the non-local problem costs no more than
one with a known bound.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.errors import Infeasible, NotConverged
from contact_locking.material import MANDEL_PAIRS
from contact_locking.progress import Monitor
from contact_locking.solver.blocks import ContactBlock, FrictionBlock, LockingBlock
from contact_locking.solver.cone_point import ConePoint, Direction
from contact_locking.solver.cone_system import ConeSystem
from contact_locking.solver.cones import Lorentz, norm
from contact_locking.solver.linear import LINEAR_FAILURE
from contact_locking.solver.measures import Measures, mean
from contact_locking.solver.multipliers import Multipliers
from contact_locking.solver.report import Settings, SolverReport
from contact_locking.solver.target import Target
from contact_locking.system import FrictionBound, PenalisedSystem

FloatArray = npt.NDArray[np.float64]

# How far a step goes towards the boundary of the cones.
_TO_BOUNDARY = 0.97
# Recentrings (Gondzio's correctors) after each predictor and corrector: at most this many, while
# the step is shorter than this, reaching this much farther, kept if the step grows by this factor.
_RECENTRINGS = 2
_LONG_ENOUGH = 0.95
_REACH = 0.3
_GAIN = 1.01
# The predictor tells where the bound goes, until it has changed by less than this: then the
# complementarity that the predictor takes away is all it sees.  From there on, and where a step is
# longer than this, the bound at the step's own end is worth another solve.
_ALMOST_AGREED = 1e-5
_NEARLY_FULL = 0.9
# The duality gap, relative to the elastic energy, at which the iteration stops, and the share of
# it that is aimed at.  Rounding in nearly singular cones leaves about 1e-9.
_GAP_TOLERANCE = 1e-8
_GAP_LEFT = 0.5
# A gap that has become smaller may grow by this factor in a step.
_GAP_BACK = 10.0
# The gap may not be a smaller share than this of the other residuals.
_GAP_AHEAD = 1e-2
# A friction bound that is waited for changes less by this factor in each iteration.
_SETTLES = 0.5
# The share of the duality gap, or of the tolerance, that a linear solve may leave as residual:
# sharper solves save a tangent or two and cost more than these.
_LINEAR_SHARE = 0.3
# It leaves no more than this share of the forces.  At the beginning, when the residual is a hundred
# times as large as they are, solves that left more led to short steps, at n = inf to five tangents
# more or nowhere.
_MOST_LEFT = 0.03
# Multipliers that have grown by this factor while the laws stay violated will not come back.
_DIVERGED = 1e4
# Where nothing pulls, any strain is a start; the squares of smaller ones have no digits.
_NO_STRAIN, _SOME_STRAIN = 1e-60, 1e-3
# Forces and energies are judged against this share of those at the start if they are smaller:
# a body at rest has none to compare with.
_LEAST = 1e-4
# The start: the elastic body, stiffer by this factor, so that few of its cells are far beyond their
# limit; complementarity against stiffness times the square of the strain without that stiffness;
# and the least opening against strain times length.  On coarse meshes all of this hardly matters;
# at h = 1/256 a factor of 10 costs four tangents more, and a level three times higher two.
_START_STIFFNESS = 100.0
_START_LEVEL = 0.125
_START_OPENING = 0.1


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
        self._bound_moves = bound_moves
        self._system, self._target = system, target
        self._settings, self._monitor = settings, monitor
        self._lorentz = Lorentz(system.comm)
        self._cones = cones = ConeSystem(system, settings, target.stiffness)
        self._unstrained = np.zeros((len(MANDEL_PAIRS[cones.dim]), len(cones.limit)))
        self._point = ConePoint(cones, target.length, self._locking_block(self._unstrained))
        self._friction_change, self._awaited = 0.0, math.inf
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
        self._friction_change, self._first, self._awaited = 0.0, None, math.inf
        try:
            self._start(report)
        except PETSc.Error as error:
            raise NotConverged(LINEAR_FAILURE) from error
        finally:
            report.linear += self._cones.take_iterations()
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
                raise NotConverged(
                    f"{limit} interior point iterations did not suffice ({measures})"
                )
            self._iterate(report)
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
        """An elastic solve, with springs for a foundation, gives the place to start around."""
        cones, system, target = self._cones, self._system, self._target
        zeros = self._unstrained
        springs = push = None
        if cones.surface is not None:
            springs = np.full(len(cones.node_gap), target.stiffness / target.length)
            # They rest where the foundation is if it is inside the body.
            push = springs * np.maximum(-cones.node_gap, 0.0)
        stiff = np.full(len(cones.limit), _START_STIFFNESS * target.stiffness)
        cones.set_scaling((stiff, 0.0 * stiff, zeros), springs, None)
        report.tangents += 1
        cones.visit()
        cones.move(1.0, cones.solve_step(zeros, push, None, _MOST_LEFT))
        strain = cones.strains(system.u.x.array)
        size = mean(cones.comm, cones.volumes, norm(strain))
        size = size or self._largest_displacement() / target.length
        if size < _NO_STRAIN:
            size = _SOME_STRAIN
        locking = self._locking_block(strain)
        level = _START_LEVEL * target.stiffness * ((1.0 + _START_STIFFNESS) * size) ** 2
        locking.start(level)
        self._least_energy = _LEAST * target.stiffness * size**2 * target.length**cones.dim
        self._least_force = self._least_energy / (size * target.length)
        contact = friction = None
        if system.bound is not None:
            least = _START_OPENING * size * target.length
            opening = cones.node_gap - cones.normal_displacements(system.u.x.array)
            contact = ContactBlock(opening, cones.node_weights, target.epsilon, least)
            contact.start(level * target.length)
            friction = self._start_friction(system.bound, contact.z, least)
        self._point = ConePoint(cones, target.length, locking, contact, friction)

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
        epsilon = self._target.epsilon
        return FrictionBlock(self._lorentz, slips, cones.node_weights, epsilon, values, least)

    def _locking_block(self, strain: FloatArray) -> LockingBlock:
        cones = self._cones
        compliance = 0.5 / self._target.n
        return LockingBlock(self._lorentz, strain, cones.limit, cones.volumes, compliance)

    def _iterate(self, report: SolverReport) -> None:
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
        if not t > 1e-8:
            raise NotConverged(f"the interior point step vanished ({self._measured})")
        point.advance(t, step)
        if self._moving is not None:
            self._follow(*self._moving)
            report.friction += 1

    @property
    def _moving(self) -> tuple[FrictionBound, ContactBlock, FrictionBlock] | None:
        """What takes part where the friction bound follows the pressure."""
        bound, point = self._system.bound, self._point
        if bound is None or point.contact is None or point.friction is None:
            return None
        return (bound, point.contact, point.friction) if self._bound_moves else None

    def _follow(self, bound: FrictionBound, contact: ContactBlock, friction: FrictionBlock) -> None:
        """Set the bound to what the pressure asks for, and note how far that is; collective."""
        cones = self._cones
        new = self._new_bound(bound, contact.z)
        used = bound.values.copy()
        used[cones.active] = friction.bound
        size = max(bound.norm(new), self._target.least_bound(cones.energy, cones.dim))
        self._friction_change = bound.norm(new - used) / size if size > 0.0 else 0.0
        bound.values = new
        friction.set_bound(new[cones.active])

    def _combined(self, affine: Direction, t: float, target: float) -> tuple[Direction, float]:
        """The step to take and its length: corrected, recentred, and with the bound moved along.

        Everything here uses the factorisation that the predictor ``affine`` of length ``t`` has.
        """
        point = self._point
        corrections = point.corrections(affine)
        agreed = self._measured.friction <= _ALMOST_AGREED
        if not agreed:
            self._move_bound(t, affine)
        best = self._direction(target, corrections)
        t = self._length(best)
        for _ in range(_RECENTRINGS):
            if t >= _LONG_ENOUGH:
                break
            trial = point.recentred(corrections, min(1.0, t + _REACH), best, target)
            candidate = self._direction(target, trial)
            longer = self._length(candidate)
            if longer < _GAIN * t:
                break
            best, corrections, t = candidate, trial, longer
        if (agreed or t >= _NEARLY_FULL) and self._move_bound(t, best):
            best = self._direction(target, corrections)
            t = self._length(best)
        return best, t

    def _move_bound(self, t: float, direction: Direction) -> bool:
        """Let the step take the bound to where a step of length t along ``direction`` wants it."""
        if self._moving is None:
            return False
        bound, contact, friction = self._moving
        pressure = np.maximum(contact.z + t * direction[1][1][1], 0.0)
        new = self._new_bound(bound, pressure)[self._cones.active]
        friction.bound_step = new - friction.bound
        return True

    def _direction(self, target: float, corrections: list[Any] | None) -> Direction:
        """A linear solve may leave a share of what the iteration has not yet achieved."""
        accuracy = _LINEAR_SHARE * max(self._settings.tolerance, self._measured.gap)
        return self._point.direction(target, corrections, min(accuracy, _MOST_LEFT))

    def _length(self, direction: Direction) -> float:
        return min(1.0, _TO_BOUNDARY * self._point.longest_step(direction))

    def _limited(self, centring: float) -> float:
        """Keep the complementarity from running ahead of equilibrium, and from vanishing.

        Products that are much smaller than the residuals block every step, and products below the
        tolerance only lose digits.  Below it they are led back to one place, so that the pressure
        stands still while the friction bound settles.
        """
        now = self._measured
        if now.gap < _GAP_AHEAD * now.equilibrium:
            return 1.0
        # Where contact only grazes, the pressure falls with the products: waiting does not help.
        if now.gap < _GAP_AHEAD * now.friction < _GAP_AHEAD * _SETTLES * self._awaited:
            self._awaited = now.friction
            return 1.0
        self._awaited = math.inf
        return max(centring, min(_GAP_BACK, _GAP_LEFT * _GAP_TOLERANCE / now.gap))

    def _stop_if_infeasible(self, measures: Measures) -> None:
        """Multipliers that grow without bound while the laws stay violated: nothing is feasible."""
        if self._target.epsilon > 0.0 and math.isfinite(self._target.n):
            return
        point = self._point
        size = point.largest_multiplier()
        if self._first is None:
            self._first = size, measures.primal
        first_size, first_primal = self._first
        if size > _DIVERGED * first_size and measures.primal > 0.01 * first_primal:
            raise Infeasible(
                "infeasible: no displacement within the locking limit and the gap follows the "
                f"prescribed values; {self._cones.describe_excess(point.strain)}",
                point.excluded_factor(),
            )

    def _measure(self) -> Measures:
        """Look at the iterate and judge it; collective."""
        cones, point = self._cones, self._point
        point.visit()
        return Measures(
            point.equilibrium_residual() / max(cones.force_scale, self._least_force),
            point.primal_residual(),
            point.total_product() / max(cones.energy, self._least_energy),
            self._friction_change,
        )

    def multipliers(self) -> Multipliers:
        """Those of the present iterate; collective."""
        return self._point.multipliers(self._target.stiffness)

    def _new_bound(self, bound: FrictionBound, pressure: FloatArray) -> FloatArray:
        """``mu |R p|``, kept positive so that the friction cones have an inside."""
        new = bound.evaluate(self._cones.at_all_nodes(pressure))
        return np.maximum(new, 1e-14 * self._target.stiffness)

    def _largest_displacement(self) -> float:
        local = float(np.max(np.abs(self._system.u.x.array), initial=0.0))
        return float(self._cones.comm.allreduce(local, op=MPI.MAX))
