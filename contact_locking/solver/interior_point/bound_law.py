"""The law of a friction bound, linearised: how the bound follows pressure and slip."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.direction import Direction
from contact_locking.solver.interior_point.moving_bound import MovingBound


class BoundLaw:
    """``G = mu(|u_tau|) |R p|`` on one part of Gamma_C, linearised at the iterate.

    Values are those of the nodes of the cones, (k,); collective to make.
    """

    def __init__(self, moving: MovingBound, most_taken: float) -> None:
        self._most_taken = most_taken
        contact, bound = moving.contact, moving.contact.friction
        self._contact, self.friction = moving.pressing, moving.friction
        self._nodes, self._smoothing = self.friction.nodes, bound.smoothing
        slips = contact.slips(moving.u)
        mu = bound.coefficient(slips)
        pressure = self._nodes.at_all(self._contact.z)
        smoothed = bound.smoothing.apply(pressure)
        wanted = mu * np.abs(smoothed) if bound.is_coulomb else bound.evaluate(pressure, slips)
        self._wanted = self._nodes.of_all(wanted)
        self._mu = float(bound.is_coulomb) * self._nodes.of_all(mu)
        slip = self.friction.seen
        size = np.sqrt(np.sum(slip**2, axis=0))
        self._along = slip / np.maximum(size, np.finfo(float).tiny)
        self._slope = moving.slope()

    def distance(self, direction: Direction) -> FloatArray:
        """The residual of the equation for a direction; collective."""
        friction = self.friction
        slip_step = friction.slip_step(direction.steps[friction])
        wanted = self._wanted + self.moved(direction.steps[self._contact].dual, slip_step)
        return wanted - friction.bound - friction.bound_step

    def missed(self, direction: Direction) -> FloatArray:
        """The same, but for a bound that would have to fall farther than it may; collective."""
        left, friction = self.distance(direction), self.friction
        is_cut = friction.bound_step <= -self._most_taken * friction.bound
        return np.where(is_cut, np.maximum(left, 0.0), left)

    def change(self, change: FloatArray) -> bool:
        """Change the step of the bound, which stays positive; whether that cut it on this rank."""
        friction = self.friction
        step, least = friction.bound_step + change, -self._most_taken * friction.bound
        friction.bound_step = np.asarray(np.maximum(step, least))
        return bool(np.any(step < least))

    def moved_by(self, displacement: FloatArray) -> FloatArray:
        """What a response of the displacement (owned values) does to the law; collective."""
        pressure_step = self._contact.response(self._contact.see(displacement))
        return self.moved(pressure_step, self.friction.see(displacement))

    def moved(self, pressure_step: FloatArray, slip_step: FloatArray) -> FloatArray:
        """``mu R dp + mu'(s) |R p| ds``, without what the cones make the bound grow by."""
        nodes = self._nodes
        smoothed = nodes.of_all(self._smoothing.apply(nodes.at_all(pressure_step)))
        along = np.einsum("ik,ik->k", self._along, slip_step)
        moved = self._mu * smoothed + self._slope * along
        return np.asarray(moved - self.friction.grown(slip_step))

    def moved_adjoint(self, bound: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The adjoint of the map from steps of pressure and slip to the bound; collective.

        A bound (k,) gives a pressure (k,) and a slip (d, k), as ``int`` pairs all of them.
        """
        nodes, friction = self._nodes, self.friction
        pressure = nodes.of_all(self._smoothing.adjoint(nodes.at_all(self._mu * bound)))
        slip = self._slope * bound * self._along - friction.grown_adjoint(bound)
        return pressure, np.asarray(slip)
