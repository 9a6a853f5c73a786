"""Newton's step of the friction bounds, inside a step of the interior point method.

The bound ``G = mu(|u_tau|) |R p|`` (6) follows pressure and slip, which follow the bound: with
``dp(b)`` and ``ds(b)`` the steps of pressure and slip that belong to a step b of the bound,

    b - mu R dp(b) - mu'(s) |R p| ds(b) = mu |R p| - G.

All of it is linear in b.  Of a bound of the user's own nothing is known but its value: without the
derivatives the step is that to the new value.  The unknowns are those of the nodes of all parts of
Gamma_C with friction together, so GMRES solves for them with one back-substitution an iteration, by
the factorisation that the step has anyway.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from contact_locking.solver.interior_point.family import Direction, Reaction
from contact_locking.solver.interior_point.moving_bound import MovingBound
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.interior_point.tuning import Tuning

FloatArray = npt.NDArray[np.float64]

_PREFIX = "contact_locking_bound_"


class BoundStep:
    """The step of the bounds that belongs to a step of the iterate; made once for each tangent."""

    def __init__(self, bounds: Sequence[MovingBound], tangent: Tangent, tuning: Tuning) -> None:
        self._tangent, self._tuning = tangent, tuning
        self._laws = [_BoundLaw(bound) for bound in bounds]
        counts = [len(law.friction.weights) for law in self._laws]
        self._ends = np.cumsum(counts)[:-1]

    def adapt(self, direction: Direction) -> None:
        """Set the step of each bound to what agrees with a direction and itself; collective.

        The direction is one with the steps of the bounds that are set before.
        """
        if not self._laws:
            return
        right = [law.distance(direction) for law in self._laws]
        changes = np.split(self._solve(np.concatenate(right)), self._ends)
        for law, change in zip(self._laws, changes, strict=True):
            law.change(change, self._tuning.bound_most_taken)

    def _left_by(self, steps: FloatArray) -> FloatArray:
        """``b - mu R dp(b) - mu'(s) |R p| ds(b)`` for steps b of all bounds; collective."""
        parts = list(zip(self._laws, np.split(steps, self._ends), strict=True))
        reactions = [Reaction(law.friction, law.friction.response(part)) for law, part in parts]
        du = self._tangent.respond(reactions, self._tuning.linear_loosest)
        return np.concatenate([part - law.moved_by(du) for law, part in parts])

    def _solve(self, right: FloatArray) -> FloatArray:
        comm, most = self._tangent.comm, self._tuning.bound_iterations
        size = ((len(right), None), (len(right), None))
        matrix = PETSc.Mat().createPython(size, _Map(self._left_by), comm=comm)
        matrix.setUp()
        x, b = matrix.createVecs()
        b.array_w[:] = right
        ksp = PETSc.KSP().create(comm)
        ksp.setOptionsPrefix(_PREFIX)
        ksp.setType(PETSc.KSP.Type.GMRES)
        ksp.setOperators(matrix)
        ksp.getPC().setType(PETSc.PC.Type.NONE)
        ksp.setTolerances(rtol=self._tuning.bound_rtol, max_it=most)
        ksp.setGMRESRestart(most)
        ksp.solve(b, x)
        step = x.array_r.copy()
        for item in (ksp, matrix, x, b):
            item.destroy()
        return step


class _BoundLaw:
    """``G = mu(|u_tau|) |R p|`` on one part of Gamma_C, linearised at the iterate.

    Values are those of the nodes of the cones, (k,); collective to make.
    """

    def __init__(self, moving: MovingBound) -> None:
        contact, bound = moving.contact, moving.contact.friction
        self._contact, self.friction = moving.pressing, moving.friction
        self._nodes, self._smoothing = self.friction.nodes, bound.smoothing
        slips = contact.slips(moving.u)
        mu, slope = bound.coefficient(slips), bound.slope(slips)
        pressure = self._nodes.at_all(self._contact.z)
        smoothed = bound.smoothing.apply(pressure)
        known = float(bound.is_coulomb)
        wanted = mu * np.abs(smoothed) if bound.is_coulomb else bound.evaluate(pressure, slips)
        self._wanted = self._nodes.of_all(wanted)
        self._mu = known * self._nodes.of_all(mu)
        slip = self.friction.seen
        size = np.sqrt(np.sum(slip**2, axis=0))
        self._along = slip / np.maximum(size, np.finfo(float).tiny)
        self._slope = known * self._nodes.of_all(slope * np.abs(smoothed))

    def distance(self, direction: Direction) -> FloatArray:
        """What a direction leaves of the equation; collective."""
        friction = self.friction
        slip_step = friction.slip_step(direction.steps[friction])
        wanted = self._wanted + self._moved(direction.steps[self._contact].dual, slip_step)
        return wanted - friction.bound - friction.bound_step

    def change(self, change: FloatArray, most_taken: float) -> None:
        """Change the step of the bound, which stays positive."""
        friction = self.friction
        step = np.maximum(friction.bound_step + change, -most_taken * friction.bound)
        friction.bound_step = np.asarray(step)

    def moved_by(self, displacement: FloatArray) -> FloatArray:
        """What a response of the displacement (owned values) does to the law; collective."""
        pressure_step = self._contact.response(self._contact.see(displacement))
        return self._moved(pressure_step, self.friction.see(displacement))

    def _moved(self, pressure_step: FloatArray, slip_step: FloatArray) -> FloatArray:
        """``mu R dp + mu'(s) |R p| ds``."""
        nodes = self._nodes
        smoothed = nodes.of_all(self._smoothing.apply(nodes.at_all(pressure_step)))
        along = np.einsum("ik,ik->k", self._along, slip_step)
        return np.asarray(self._mu * smoothed + self._slope * along)


class _Map:
    """A linear map of arrays as PETSc's shell matrix."""

    def __init__(self, apply: Callable[[FloatArray], FloatArray]) -> None:
        self._apply = apply

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array_w[:] = self._apply(x.array_r.copy())
