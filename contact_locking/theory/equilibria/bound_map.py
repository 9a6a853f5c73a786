"""The map of friction bounds whose fixed points are the equilibria, with its derivative.

``Phi(G) = mu(|u_tau(G)|) |R p(G)|``, where ``u(G)`` and ``p(G)`` solve Tresca's problem, friction
under the known bound G, which is convex.  Its unknowns are those of the nodes of Gamma_C with
friction, few beside those of the body.
"""

from __future__ import annotations

import math

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.interior_point.bound_step import BoundLaw
from contact_locking.solver.interior_point.family import Reaction
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.task import LastIterate, Outcome, Task

# No bound is a smaller share of the largest, so that the friction cones have an inside.
_LEAST = 1e-12


class BoundVectors:
    """Friction bounds of all contacts as vectors (m,), the same on all ranks.

    They hold the nodes at which friction acts, rank by rank and contact by contact.  ``weights``
    (m,) are those of the nodes.  The constructor is collective.
    """

    def __init__(self, system: PenalisedSystem) -> None:
        self._comm, self._bounds = system.comm, system.bounds
        self.contacts = system.rubbing
        self._counts = [int(np.count_nonzero(item.free)) for item in self.contacts]
        sizes = self._comm.allgather(sum(self._counts))
        first = sum(sizes[: self._comm.rank])
        self._own = slice(first, first + sizes[self._comm.rank])
        self.size = sum(sizes)
        self.weights = self.gather([item.surface.weights for item in self.contacts])
        self.ones: FloatArray = np.ones(self.size)

    def gather(self, values: list[FloatArray]) -> FloatArray:
        """The vector of values at the owned nodes of each contact; collective."""
        pairs = zip(values, self.contacts, strict=True)
        return self.join([part[contact.free] for part, contact in pairs])

    def join(self, values: list[FloatArray]) -> FloatArray:
        """The vector of values at the nodes of each contact where friction acts; collective."""
        local: FloatArray = np.concatenate([*values, np.empty(0)])
        return np.concatenate(self._comm.allgather(local))

    def split(self, vector: FloatArray) -> list[FloatArray]:
        """The values of this rank at the nodes of each contact where friction acts."""
        return np.split(vector[self._own], np.cumsum(self._counts)[:-1])

    def enter(self, vector: FloatArray) -> None:
        """Let the bounds of a vector be in force; collective."""
        for contact, part in zip(self.contacts, self.split(vector), strict=True):
            bounds = np.zeros(len(contact.free))
            bounds[contact.free] = part
            self._bounds[contact] = bounds

    def in_force(self) -> FloatArray:
        """The vector of the bounds in force; collective."""
        return self.gather(self._bounds.at(self.contacts))

    def dot(self, a: FloatArray, b: FloatArray) -> float:
        """``int a b`` over Gamma_C by the weights of the nodes, alike on all ranks; collective."""
        return float(self._comm.bcast(float(self.weights @ (a * b))))

    def norm(self, a: FloatArray) -> float:
        """The L2 norm on Gamma_C; collective."""
        return math.sqrt(self.dot(a, a))

    def solved(self, matrix: FloatArray, right: FloatArray) -> tuple[FloatArray, float]:
        """The solution of a dense system and its determinant's sign, or NaN and 0; collective."""
        solution: FloatArray = np.full_like(right, np.nan)
        sign = 0.0
        if self._comm.rank == 0 and np.all(np.isfinite(matrix)):
            sign = float(np.linalg.slogdet(matrix)[0])
            if sign != 0.0:
                solution = np.asarray(np.linalg.solve(matrix, right))
        found: tuple[FloatArray, float] = self._comm.bcast((solution, sign))
        return found


class BoundMap:
    """``G -> Phi(G)``: a Tresca problem for each value, and back-substitutions for the derivative.

    A bound that is negative counts as zero.  ``found`` is the solution of the last value, and
    ``last`` an iterate near the first, if one is known.  The constructor and all methods are
    collective.
    """

    def __init__(self, task: Task, last: LastIterate | None = None) -> None:
        self._task, self.vectors = task, BoundVectors(task.system)
        self._solver = InteriorPoint(task, bound_moves=False)
        self.found = Outcome(last=last)
        self._inside = np.ones(self.vectors.size, dtype=bool)

    def __call__(self, bounds: FloatArray) -> FloatArray:
        """``Phi(G)`` (m,); raises NotConverged where Tresca's problem is not solved."""
        system = self._task.system
        self._inside = bounds > 0.0
        used = np.maximum(bounds, 0.0)
        self.vectors.enter(np.maximum(used, _LEAST * np.max(used, initial=0.0)))
        system.u.x.array[:] = 0.0
        system.constraints.apply(system.u)
        # Along a branch the solution before is near.
        self.found = self._solver.solve(self.found.last)
        wanted = zip(self.vectors.contacts, self._pressures(), strict=True)
        return self.vectors.gather([item.friction_bound(system.u, p) for item, p in wanted])

    def pressures(self) -> FloatArray:
        """The contact pressures (m,) at the last value."""
        return self.vectors.gather(self._pressures())

    def _pressures(self) -> list[FloatArray]:
        assert self.found.multipliers is not None
        pairs = zip(self._task.system.contacts, self.found.multipliers.contacts, strict=True)
        return [item.pressure for contact, item in pairs if contact in self.vectors.contacts]

    def derivative(self) -> FloatArray:
        """``Phi'(G)`` (m, m) at the last value, by a back-substitution for each node."""
        size = self.vectors.size
        found = np.zeros((size, size))
        laws = self._solver.linearised_bounds()
        if not laws:
            return found
        for column in np.flatnonzero(self._inside):
            step = np.zeros(size)
            step[column] = 1.0
            found[:, column] = self._moved(laws, step)
        return found

    def _moved(self, laws: list[BoundLaw], step: FloatArray) -> FloatArray:
        pairs = zip(laws, self.vectors.split(step), strict=True)
        reactions = [Reaction(law.friction, law.friction.response(part)) for law, part in pairs]
        displacement = self._solver.respond(reactions)
        return self.vectors.join([law.moved_by(displacement) for law in laws])

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._solver.destroy()
