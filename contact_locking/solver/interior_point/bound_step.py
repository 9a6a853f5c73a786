"""Newton's step of the friction bounds, inside a step of the interior point method.

The bound ``G = mu(|u_tau|) |R p|`` (6) depends on pressure and slip, and these on the bound.  With
the steps ``dp(b)`` and ``ds(b)`` of pressure and slip for a step b of the bound,

    b - mu R dp(b) - mu'(s) |R p| ds(b) = mu |R p| - G,

which is linear in b.  If friction grows with the slip, ``mu' > 0``, the tangent contains that
growth (:class:`FrictionCones`), which may be the only stiffness along a slip, and b is the rest of
the step.  A user's own bound has no derivatives, and b is then the step to its new value.

The unknowns are the bounds at all nodes with friction.  With a direct solver a Krylov method finds
them, with one back-substitution in each iteration.  With an iterative solver each of these would
cost as much as the step itself; it solves for displacement and bounds together, where the forces of
the bounds are functions of the displacement (:mod:`contact_locking.solver.tangent_solver`).

Unless friction is large, the map ``b -> mu R dp(b) + mu'(s) |R p| ds(b)`` is a strong contraction.
The bound by the predictor is then nearly right for the corrector, which is solved with it, and
often no further back-substitution is needed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.contact.coulomb import FrictionBound
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.contact_cones import ContactCones, FrictionCones
from contact_locking.solver.interior_point.family import Direction, Reactions
from contact_locking.solver.interior_point.lorentz import dot, norm
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.interior_point.tuning import Tuning


@dataclass(frozen=True)
class MovingBound:
    """``G = mu(|u_tau|) |R p|`` of a contact; collective.

    - ``system``: has the bounds in force
    - ``pressing``, ``friction``: the cones that p comes from, and those that use G
    - ``least``: the least bound over the largest, positive so that friction cones have an interior
    - ``share``: the share of the friction coefficient that acts
    """

    system: System
    contact: NodalContact
    pressing: ContactCones
    friction: FrictionCones
    least: float
    share: float = 1.0

    @property
    def law(self) -> FrictionBound:
        """The friction law of the contact."""
        return self.contact.friction

    @property
    def in_force(self) -> FloatArray:
        """The bound in force at all nodes of the contact."""
        return self.system.bounds[self.contact]

    def set(self, bound: FloatArray) -> None:
        """Set the bound in force at all nodes of the contact."""
        self.system.bounds[self.contact] = bound

    def start(self, moves: bool, least: float) -> None:
        """Start the friction cones under the bound in force, or of the pressure if it moves."""
        if moves:
            self.set(self.evaluate())
        self.friction.takes_part = not self.is_zero()
        if self.friction.takes_part:
            bound = self.friction.nodes.of_all(self.in_force)
            self.friction.start_under(bound, self.pressing.z, least)

    def is_zero(self) -> bool:
        """Whether the bound in force is zero everywhere."""
        return self.contact.norm(self.in_force) == 0.0

    def evaluate(self) -> FloatArray:
        """``mu |R p|`` at all nodes of the contact."""
        return self.evaluate_at(self.pressing.z)

    def evaluate_at(self, pressure: FloatArray) -> FloatArray:
        """``mu |R p|`` at all nodes of the contact for a pressure (k,) of the cones."""
        at_all = self.pressing.nodes.at_all(pressure)
        slips = self.contact.slips(self.system.u)
        new = self.share * self.contact.rubbing(self.law.evaluate(at_all, slips))
        least = self.least * maximum(self.pressing.comm, new)
        return self.contact.acting(np.maximum(new, least))

    def slope(self) -> FloatArray:
        """``mu'(|u_tau|) |R p|`` (k,) at the nodes of the cones, 0 for a user's own bound."""
        bound, nodes = self.law, self.friction.nodes
        if not (bound.is_coulomb and bound.depends_on_slip):
            return np.zeros(len(nodes.weights))
        smoothed = bound.smoothing.apply(nodes.at_all(self.pressing.z))
        slope = self.share * bound.slope(self.contact.slips(self.system.u))
        return nodes.of_all(self.contact.rubbing(slope * np.abs(smoothed)))


class BoundStep:
    """The step of all moving bounds with a step of the iterate, for one tangent; collective.

    ``contracts`` says whether the map ``b -> mu R dp(b) + mu'(s) |R p| ds(b)`` is a strong
    contraction: first at the last tangent, and after a solve at this one.
    """

    def __init__(
        self,
        bounds: Sequence[MovingBound],
        tangent: Tangent,
        tuning: Tuning,
        contracts: bool = False,
    ) -> None:
        self._tangent, self._tuning, self.contracts = tangent, tuning, contracts
        self._bounds = bounds
        self.linearise()
        counts = [len(law.friction.weights) for law in self._laws]
        self._ends = np.cumsum(counts)[:-1]
        # Steps of the bounds, their images by the equation, and their displacements.
        self._known: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        self._predicted = 0.0

    def linearise(self) -> None:
        """Linearise the laws at the iterate; known responses of the tangent are kept."""
        most = self._tuning.bound_most_taken
        self._laws = [BoundLaw(bound, most) for bound in self._bounds]

    def predict(self, predictor: Direction) -> None:
        """Set the step of each bound to that of the predictor, if the map contracts.

        These steps nearly agree with the corrector, which saves back-substitutions.
        """
        if not self.contracts:
            return
        steps = [law.distance(predictor) for law in self._laws]
        self._predicted = self._norm(np.concatenate(steps))
        self._change(steps)

    def agrees(self, direction: Direction) -> bool:
        """Whether the steps of the bounds nearly agree with a direction."""
        residual = self._norm(np.concatenate([law.distance(direction) for law in self._laws]))
        return residual <= self._enough(residual)

    def reset(self) -> None:
        """Set the step of each bound to zero."""
        for law in self._laws:
            law.friction.bound_step = np.zeros(len(law.friction.weights))

    def stand(self, rest: Direction) -> None:
        """Set the steps of the bounds for du = 0, without a least bound.

        ``rest`` is the direction for zero steps of displacement and bounds.
        """
        for law in self._laws:
            law.friction.bound_step = law.distance(rest)

    def following(self, displacement: FloatArray) -> Reactions:
        """The reactions to the steps of the bounds that a displacement step adds."""
        return self._reactions(law.moved_by(displacement) for law in self._laws)

    def follow(self, displacement: FloatArray) -> bool:
        """Add the steps of the bounds by a displacement step; False if a bound is cut."""
        return self._change(law.moved_by(displacement) for law in self._laws)

    def _change(self, steps: Iterable[FloatArray]) -> bool:
        """Change the step of each bound; False if a bound is cut."""
        parts = zip(self._laws, steps, strict=True)
        is_cut = any([law.change(part) for law, part in parts])
        return not on_any_rank(self._tangent.comm, is_cut)

    def _reactions(self, steps: Iterable[FloatArray]) -> Reactions:
        """The change of friction by the steps of the bounds for du = 0."""
        parts = zip(self._laws, steps, strict=True)
        return {law.friction: law.friction.response(part) for law, part in parts}

    def misses(self, direction: Direction) -> float:
        """The relative distance of the steps of the bounds from those that agree."""
        missed = np.concatenate([law.missed(direction) for law in self._laws])
        moved = np.concatenate([law.friction.bound + law.friction.bound_step for law in self._laws])
        return self._norm(missed) / (self._norm(moved) or 1.0)

    def adapt(self, direction: Direction) -> FloatArray | None:
        """Make the bounds agree; returns the change of displacement, None if a bound is cut."""
        right = np.concatenate([law.distance(direction) for law in self._laws])
        change, displacement = self._solve(right)
        return displacement if self._change(np.split(change, self._ends)) else None

    def _solve(self, right: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The steps of the bounds for a right-hand side, and their displacement.

        Generalised conjugate residuals, which reuse the search directions of earlier solves.
        """
        change, residual, start = np.zeros_like(right), right.copy(), self._norm(right)
        displacement = self._tangent.zeros()
        for i in range(self._tuning.bound_iterations):
            size = self._norm(residual)
            # The responses of an iterative solver are too rough for this test.
            if i == 1 and self._tangent.direct is not None:
                self.contracts = size <= self._tuning.bound_contracts * start
            if i >= len(self._known):
                if not size > self._enough(start):
                    break
                self._learn(residual)
            step, image, moved = self._known[i]
            share = self._dot(image, residual)
            change += share * step
            displacement += share * moved
            residual -= share * image
        return change, displacement

    def _enough(self, start: float) -> float:
        """The residual at which the equation counts as solved; ``start`` is the first one."""
        rough = self._tuning.bound_rtol_predicted * self._predicted if self.contracts else 0.0
        return max(rough, self._tuning.bound_rtol * start)

    def _learn(self, step: FloatArray) -> None:
        """Compute the response to one more step, orthogonalised against the known ones."""
        reactions = self._reactions(np.split(step, self._ends))
        du = self._tangent.respond(reactions, self._tuning.linear_loosest)
        moved = np.concatenate([law.moved_by(du) for law in self._laws])
        new = step.copy(), step - moved, du
        for known in self._known:
            share = self._dot(known[1], new[1])
            for values, others in zip(new, known, strict=True):
                values -= share * others
        size = self._norm(new[1]) or 1.0
        for values in new:
            values /= size
        self._known.append(new)

    def _dot(self, a: FloatArray, b: FloatArray) -> float:
        return float(self._tangent.comm.allreduce(float(a @ b)))

    def _norm(self, a: FloatArray) -> float:
        return math.sqrt(self._dot(a, a))


class BoundLaw:
    """``G = mu(|u_tau|) |R p|`` on one part of Gamma_C, linearised at the iterate; collective.

    Values are those at the nodes of the cones, (k,).
    """

    def __init__(self, moving: MovingBound, most_taken: float) -> None:
        self._most_taken = most_taken
        contact, bound = moving.contact, moving.law
        self._contact, self.friction = moving.pressing, moving.friction
        self._nodes, self._smoothing = self.friction.nodes, bound.smoothing
        slips = contact.slips(moving.system.u)
        pressure = self._nodes.at_all(self._contact.z)
        smoothed = bound.smoothing.apply(pressure)
        # R of quadratic traces may be negative where p >= 0.
        mu = moving.share * bound.coefficient(slips) * np.where(smoothed < 0.0, -1.0, 1.0)
        by_law = mu * smoothed
        if not bound.is_coulomb:
            by_law = moving.share * bound.evaluate(pressure, slips)
        self._by_law = self._nodes.of_all(contact.rubbing(by_law))
        self._mu = float(bound.is_coulomb) * self._nodes.of_all(contact.rubbing(mu))
        slip = self.friction.seen
        self._along = slip / np.maximum(norm(slip), np.finfo(float).tiny)
        self._slope = moving.slope()

    def distance(self, direction: Direction) -> FloatArray:
        """The residual of the equation for a direction."""
        friction = self.friction
        slip_step = friction.slip_step(direction.of(friction))
        by_law = self._by_law + self.moved(direction.of(self._contact).dual, slip_step)
        return by_law - friction.bound - friction.bound_step

    def missed(self, direction: Direction) -> FloatArray:
        """The residual, without that of bounds that would have to fall farther than allowed."""
        residual, friction = self.distance(direction), self.friction
        is_cut = friction.bound_step <= -self._most_taken * friction.bound
        return np.where(is_cut, np.maximum(residual, 0.0), residual)

    def change(self, change: FloatArray) -> bool:
        """Change the step of the bound, cut so that it stays positive; True if cut on this rank."""
        friction = self.friction
        step, least = friction.bound_step + change, -self._most_taken * friction.bound
        friction.bound_step = np.asarray(np.maximum(step, least))
        return bool(np.any(step < least))

    def moved_by(self, displacement: FloatArray) -> FloatArray:
        """The change of the bound by a response of the displacement (owned values)."""
        pressure_step = self._contact.block(self._contact.see(displacement))
        return self.moved(pressure_step, self.friction.see(displacement))

    def moved(self, pressure_step: FloatArray, slip_step: FloatArray) -> FloatArray:
        """``mu R dp + mu'(s) |R p| ds``, without the growth that the cones contain."""
        nodes = self._nodes
        smoothed = nodes.of_all(self._smoothing.apply(nodes.at_all(pressure_step)))
        moved = self._mu * smoothed + self._slope * dot(self._along, slip_step)
        return np.asarray(moved - self.friction.grown(slip_step))

    def moved_adjoint(self, bound: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The adjoint of :meth:`moved`: pressure and slip of a bound (k,)."""
        nodes, friction = self._nodes, self.friction
        pressure = nodes.of_all(self._smoothing.adjoint(nodes.at_all(self._mu * bound)))
        slip = self._slope * bound * self._along - friction.grown_adjoint(bound)
        return pressure, np.asarray(slip)
