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
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.errors import Infeasible, NotConverged
from contact_locking.material import MANDEL_PAIRS
from contact_locking.progress import Monitor
from contact_locking.solver.blocks import ContactBlock, FrictionBlock, LockingBlock
from contact_locking.solver.cone_system import ConeSystem
from contact_locking.solver.cones import norm
from contact_locking.solver.linear import LINEAR_FAILURE
from contact_locking.solver.measures import Measures, mean, relative_rms
from contact_locking.solver.multipliers import Multipliers
from contact_locking.solver.report import Settings, SolverReport
from contact_locking.solver.target import Target
from contact_locking.system import PenalisedSystem

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
# The share of the duality gap, or of the tolerance, that a linear solve may leave as residual:
# sharper solves save a tangent or two and cost more than these.
_LINEAR_SHARE = 0.3
# Multipliers that have grown by this factor while the laws stay violated will not come back.
_DIVERGED = 1e4
# Where nothing pulls, any strain is a start; the squares of smaller ones have no digits.
_NO_STRAIN, _SOME_STRAIN = 1e-60, 1e-3
# Forces and energies are judged against this share of those at the start if they are smaller:
# a body at rest has none to compare with.
_LEAST = 1e-4
# Starting values: complementarity against stiffness times strain squared, and the least opening
# against strain times length.  Between 3 and 300, and 0.1 and 1, the iterations change by a tenth.
_START_LEVEL = 5.0
_START_OPENING = 0.1


# A step of the displacement (local values), and the primal and dual step of each block.
Direction: TypeAlias = tuple[FloatArray, list[Any]]


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
        self._cones = cones = ConeSystem(system, settings, target.stiffness)
        self._unstrained = np.zeros((len(MANDEL_PAIRS[cones.dim]), len(cones.limit)))
        self._locking = self._locking_block(self._unstrained)
        self._contact: ContactBlock | None = None
        self._friction: FrictionBlock | None = None
        self._friction_change = 0.0
        self._first: tuple[float, float] | None = None

    def solve(self, report: SolverReport) -> Multipliers:
        """Iterate to the tolerances; raises NotConverged, the best iterate left in place."""
        # What is no number is found where steps and residuals are judged.
        with np.errstate(all="ignore"):
            return self._iterate_to_the_end(report)

    def _iterate_to_the_end(self, report: SolverReport) -> Multipliers:
        monitor, settings = self._monitor, self._settings
        self._friction, self._friction_change, self._first = None, 0.0, None
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
        report.friction_change = measures.friction
        report.duality_gap = measures.gap
        return self.multipliers()

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._cones.destroy()

    def _start(self, report: SolverReport) -> None:
        """An elastic solve, softened by springs, gives the place; the cones start around it."""
        cones, system, target = self._cones, self._system, self._target
        zeros = self._unstrained
        springs = push = None
        if cones.surface is not None:
            springs = np.full(len(cones.node_gap), target.stiffness / target.length)
            # They rest where the foundation is if it is inside the body.
            push = springs * np.maximum(-cones.node_gap, 0.0)
        soft = np.full(len(cones.limit), 10.0 * target.stiffness)
        cones.set_scaling((soft, 0.0 * soft, zeros), springs, None)
        report.tangents += 1
        cones.visit()
        cones.move(1.0, cones.solve_step(zeros, push, None, math.inf))
        strain = cones.strains(system.u.x.array)
        size = mean(cones.comm, cones.volumes, norm(strain))
        size = size or self._largest_displacement() / target.length
        if size < _NO_STRAIN:
            size = _SOME_STRAIN
        self._locking = self._locking_block(strain)
        level = _START_LEVEL * target.stiffness * size**2
        self._locking.start(level)
        self._least_energy = _LEAST * target.stiffness * size**2 * target.length**cones.dim
        self._least_force = self._least_energy / (size * target.length)
        if cones.surface is not None:
            least = _START_OPENING * size * target.length
            opening = self._opening()
            self._contact = ContactBlock(opening, cones.node_weights, target.epsilon, least)
            self._contact.start(level * target.length)
            bound = system.bound
            assert bound is not None
            if self._bound_moves and not bound.frictionless:
                bound.values = self._new_bound()
            # A bound that is nothing leaves no friction to account for.
            if not bound.frictionless and bound.norm(bound.values) > 0.0:
                self._friction = FrictionBlock(
                    cones.slips(system.u.x.array),
                    cones.node_weights,
                    target.epsilon,
                    bound.values[cones.active],
                    least,
                )

    def _locking_block(self, strain: FloatArray) -> LockingBlock:
        cones = self._cones
        return LockingBlock(strain, cones.limit, cones.volumes, 0.5 / self._target.n)

    def _iterate(self, report: SolverReport) -> None:
        cones = self._cones
        locking = self._locking.linearise(self._strain)
        contact = friction = None
        if self._contact is not None:
            contact = self._contact.linearise(self._opening())
        if self._friction is not None:
            friction = self._friction.linearise(self._slip)
            self._friction.bound_step[:] = 0.0
        try:
            cones.set_scaling(locking, contact, friction)
            report.tangents += 1
            affine = self._direction(0.0, None)
            t = min(1.0, self._longest_step(affine))
            before = self._complementarity()
            after = self._complementarity_after(t, affine)
            centring = min(1.0, max(after / before, 0.0)) ** 3
            centring = self._limited(centring)
            combined, t = self._combined(affine, t, centring * before)
        except PETSc.Error as error:
            raise NotConverged(LINEAR_FAILURE) from error
        finally:
            report.linear += self._cones.take_iterations()
        if not t > 1e-8:
            raise NotConverged(f"the interior point step vanished ({self._measured})")
        cones.move(t, combined[0])
        for block, step in zip(self._blocks, combined[1], strict=True):
            block.advance(t, *step)
        if self._friction is not None and self._bound_moves:
            bound = self._system.bound
            assert bound is not None
            new = self._new_bound()
            least = self._target.least_bound(cones.energy, cones.dim)
            size = max(bound.norm(new), least)
            used = bound.values.copy()
            used[cones.active] = self._friction.bound
            self._friction_change = bound.norm(new - used) / size if size > 0.0 else 0.0
            bound.values = new
            self._friction.set_bound(new[cones.active])
            report.friction += 1

    def _combined(self, affine: Direction, t: float, target: float) -> tuple[Direction, float]:
        """The step to take and its length: corrected, recentred, and with the bound moved along.

        Everything here uses the factorisation that the predictor ``affine`` of length ``t`` has.
        """
        corrections = [
            block.correction(*step) for block, step in zip(self._blocks, affine[1], strict=True)
        ]
        agreed = self._measured.friction <= _ALMOST_AGREED
        if not agreed:
            self._move_bound(t, affine)
        best = self._direction(target, corrections)
        t = self._length(best)
        for _ in range(_RECENTRINGS):
            if t >= _LONG_ENOUGH:
                break
            reach = min(1.0, t + _REACH)
            trial = [
                correction - block.recentring(reach, *step, target * scale)
                for correction, block, step, scale in zip(
                    corrections, self._blocks, best[1], self._scales, strict=True
                )
            ]
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
        if self._friction is None or not self._bound_moves:
            return False
        assert self._contact is not None
        pressure = np.maximum(self._contact.z + t * direction[1][1][1], 0.0)
        active = self._cones.active
        self._friction.bound_step = self._new_bound(pressure)[active] - self._friction.bound
        return True

    def _length(self, direction: Direction) -> float:
        return min(1.0, _TO_BOUNDARY * self._longest_step(direction))

    @property
    def _scales(self) -> list[float]:
        """What the target of each block is multiplied by: products on Gamma_C are per area."""
        return [1.0, self._target.length, self._target.length][: len(self._blocks)]

    def _stop_if_infeasible(self, measures: Measures) -> None:
        """Multipliers that grow without bound while the laws stay violated: nothing is feasible."""
        if self._target.epsilon > 0.0 and math.isfinite(self._target.n):
            return
        size = self._multiplier_size()
        if self._first is None:
            self._first = size, measures.primal
        first_size, first_primal = self._first
        if size > _DIVERGED * first_size and measures.primal > 0.01 * first_primal:
            raise Infeasible(
                "infeasible: no displacement within the locking limit and the gap follows the "
                f"prescribed values; {self._cones.describe_excess(self._strain)}",
                self._factor_excluded(),
            )

    def _factor_excluded(self) -> float:
        """The factor on the prescribed values u_D that the multipliers prove too large.

        Diverging multipliers balance themselves, next to them loads and elasticity are nothing.  So
        ``P = int Z : eps(v) + int p v_nu`` is the same for every v that follows u_D, and s P for
        those that follow s u_D; but it is ``int M |Z| + int p gap`` at most if v is admissible.
        """
        cones = self._cones
        stress = self._locking.stress
        pressure = None if self._contact is None else self._contact.z
        power = cones.power(self._system.u.x.array, stress, pressure)
        resistance = cones.resistance(stress, pressure)
        return resistance / power if 0.0 < resistance < power else math.inf

    def _multiplier_size(self) -> float:
        """The largest locking multiplier or pressure; collective."""
        local = float(self._locking.z[0].max(initial=0.0))
        if self._contact is not None:
            local = max(local, float(self._contact.z.max(initial=0.0)))
        return float(self._cones.comm.allreduce(local, op=MPI.MAX))

    def _limited(self, centring: float) -> float:
        """Keep the complementarity from running ahead of equilibrium, and from vanishing.

        Products that are much smaller than the residuals block every step, and products below the
        tolerance only lose digits.  Below it they are led back to one place, so that the pressure
        stands still while the friction bound settles.
        """
        now = self._measured
        if now.gap < _GAP_AHEAD * max(now.equilibrium, now.friction):
            return 1.0
        return max(centring, min(_GAP_BACK, _GAP_LEFT * _GAP_TOLERANCE / now.gap))

    def _direction(self, target: float, corrections: list[Any] | None) -> Direction:
        """The displacement step and each block's steps towards products of ``target``."""
        cones, length = self._cones, self._target.length
        given = corrections or [None] * len(self._blocks)
        stress = self._locking.aim(target, given[0])
        pressure = friction = None
        if self._contact is not None:
            pressure = self._contact.aim(target * length, given[1])
        if self._friction is not None:
            friction = self._friction.aim(target * length, given[2])
        du = cones.solve_step(stress, pressure, friction, self._linear_accuracy())
        steps: list[Any] = [self._locking.step(cones.strains(du))]
        if self._contact is not None:
            steps.append(self._contact.step(cones.normal_displacements(du)))
        if self._friction is not None:
            steps.append(self._friction.step(cones.slips(du)))
        return du, steps

    def _linear_accuracy(self) -> float:
        """What a linear solve may leave: a share of what the iteration has not yet achieved."""
        return _LINEAR_SHARE * max(self._settings.tolerance, self._measured.gap)

    def _measure(self) -> Measures:
        """Evaluate the iterate: remembers strain and slip for the next linearisation."""
        cones, displacement = self._cones, self._system.u.x.array
        cones.visit()
        self._strain = cones.strains(displacement)
        locking = self._locking.primal_residual(self._strain)
        primal = relative_rms(cones.comm, cones.volumes, locking, self._locking.x)
        pressure = friction = None
        if self._contact is not None:
            pressure = self._contact.z
            contact = self._contact.primal_residual(self._opening())
            # Openings may all be zero; what is small is judged against the body, too.
            size = np.abs(self._contact.x) + 1e-3 * self._target.length
            primal = max(primal, relative_rms(cones.comm, self._contact.weights, contact, size))
        if self._friction is not None:
            self._slip = cones.slips(displacement)
            friction = self._friction.traction
        residual = cones.residual_norm(self._locking.stress, pressure, friction)
        return Measures(
            residual / max(cones.force_scale, self._least_force),
            primal,
            self._total() / max(cones.energy, self._least_energy),
            self._friction_change,
        )

    def multipliers(self) -> Multipliers:
        """Those of the present iterate."""
        stress, contact, friction = self._locking.stress, self._contact, self._friction
        if contact is None:
            return self._cones.multipliers(stress, None, None, None)
        pressure = contact.z
        # On the central path opening times pressure is constant; the larger one, in comparable
        # units, is the one that does not vanish.
        touches = pressure > contact.x * self._target.stiffness / self._target.length
        traction = None if friction is None else friction.traction
        return self._cones.multipliers(stress, pressure, traction, touches)

    @property
    def _blocks(self) -> list[Any]:
        every = (self._locking, self._contact, self._friction)
        return [block for block in every if block is not None]

    def _opening(self) -> FloatArray:
        cones = self._cones
        return cones.node_gap - cones.normal_displacements(self._system.u.x.array)

    def _new_bound(self, pressure: FloatArray | None = None) -> FloatArray:
        """``mu |R p|``, kept positive so that the friction cones have an inside."""
        bound = self._system.bound
        assert self._contact is not None and bound is not None
        pressure = self._contact.z if pressure is None else pressure
        new = bound.evaluate(self._cones.at_all_nodes(pressure))
        return np.maximum(new, 1e-14 * self._target.stiffness)

    def _longest_step(self, direction: Direction) -> float:
        local = min(
            block.longest_step(*step)
            for block, step in zip(self._blocks, direction[1], strict=True)
        )
        return float(self._cones.comm.allreduce(local, op=MPI.MIN))

    def _total(self) -> float:
        """The duality gap: all complementarity products, integrated; collective."""
        local = sum(float(block.weights @ block.products()) for block in self._blocks)
        return float(self._cones.comm.allreduce(local))

    def _complementarity(self) -> float:
        """The mean product, those of Gamma_C divided by the length; collective."""
        return self._total() / self._measure_of_cones()

    def _complementarity_after(self, t: float, direction: Direction) -> float:
        local = 0.0
        for block, (dx, dz) in zip(self._blocks, direction[1], strict=True):
            product = (block.x + t * dx) * (block.z + t * dz)
            products = product if product.ndim == 1 else product.sum(axis=0)
            local += float(block.weights @ products)
        return float(self._cones.comm.allreduce(local)) / self._measure_of_cones()

    def _measure_of_cones(self) -> float:
        local = float(self._locking.weights.sum())
        for block in self._blocks[1:]:
            local += self._target.length * float(block.weights.sum())
        return float(self._cones.comm.allreduce(local)) or 1.0

    def _largest_displacement(self) -> float:
        local = float(np.max(np.abs(self._system.u.x.array), initial=0.0))
        return float(self._cones.comm.allreduce(local, op=MPI.MAX))
