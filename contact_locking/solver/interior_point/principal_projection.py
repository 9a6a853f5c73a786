"""The semismooth equation of a limit of the largest principal strain."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.family import Step
from contact_locking.solver.interior_point.lorentz import norm
from contact_locking.solver.interior_point.principal_cones import TURN, Frame, PrincipalCones
from contact_locking.solver.interior_point.projections import Projection
from contact_locking.solver.last_iterate import Pair


class PrincipalProjection(Projection):
    """``z = [v]^+/(1 + c compliance)`` with ``v = z - c room``: the part with positive eigenvalues.

    The derivative of ``[.]^+`` is diagonal in the frame of v, with the entries p that are 0 or 1
    and, across, the difference quotient of both eigenvalues.
    """

    def __init__(self, family: PrincipalCones, stiffness: float, stiffest: float) -> None:
        super().__init__(family, stiffness, stiffest)
        self.family: PrincipalCones = family

    def recall(self, pair: Pair) -> None:
        self.family.z = pair[1].copy()
        self.start(self.family.reactions)

    def linearise(self) -> None:
        family, v = self.family, self._shifted()
        self._active = _eigenvalues(v) > 0.0
        first, second = _eigenvalues(v)
        spread = first - second
        positive = np.maximum(first, 0.0) - np.maximum(second, 0.0)
        across = np.where(spread > 0.0, positive / np.where(spread > 0.0, spread, 1.0), first > 0.0)
        share = np.array([*self._active.astype(float), across])
        family.frame = Frame.of(v)
        self._left = 1.0 + self.c * family.compliance - share * (1.0 - self.c * self.softness)
        family.factors = self.c * share / self._left

    def evaluate(self) -> None:
        family, share = self.family, 1.0 + self.c * self.family.compliance
        left = _positive(self._shifted()) / share - TURN @ self.y
        factors = np.asarray(share / self._left)
        self.rest = family.reactions_of(family.frame.apply(factors, left))

    def step(self, seen: FloatArray) -> Step:
        dz = TURN @ (self.rest + self.family.block(seen))
        return Step(np.zeros_like(self.family.x), dz)

    def advance(self, step: Step) -> None:
        family = self.family
        self.y = family.reactions_of(_positive(TURN @ self.y + step.dual))
        v = self._shifted()
        changed = (_eigenvalues(v) > 0.0) != self._active
        self.changed = int(np.count_nonzero(changed.any(axis=0)))
        family.z = np.asarray(_positive(v) / (1.0 + self.c * family.compliance))
        family.x = np.asarray(_positive(-v) / self.c)

    def _shifted(self) -> FloatArray:
        return np.asarray(TURN @ self.y - self.c * self.family.room)


def _eigenvalues(v: FloatArray) -> FloatArray:
    """``v_0 +- |v_1|`` (2, k)."""
    length = norm(v[1:])
    return np.array([v[0] + length, v[0] - length])


def _positive(v: FloatArray) -> FloatArray:
    """``[v]^+`` (3, k), the nearest point of the cone."""
    first, second = np.maximum(_eigenvalues(v), 0.0)
    return np.vstack([0.5 * (first + second), 0.5 * (first - second) * Frame.of(v).along])
