"""Newton's step of the friction bound, inside a step of the interior point method.

The bound ``G = mu(|u_tau|) |R p|`` (6) follows pressure and slip, which follow the bound: with
``dp(b)`` and ``ds(b)`` the steps of pressure and slip that belong to a step b of the bound,

    b - mu R dp(b) - mu'(s) |R p| ds(b) = mu |R p| - G.

All of it is linear in b.  Of a bound of the user's own nothing is known but its value: without the
derivatives the step is that to the new value.  The unknowns are those of the nodes of Gamma_C, so
GMRES solves for them with one back-substitution an iteration, by the factorisation that the step
has anyway.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from contact_locking.contacts import FrictionBound
from contact_locking.solver.cone_point import ConePoint

FloatArray = npt.NDArray[np.float64]

_PREFIX = "contact_locking_bound_"
# What the linear solve leaves of its right-hand side: a sharper one saves no tangents.
_RTOL = 1e-2
_MAX_ITERATIONS = 30
# The bound stays positive: a step takes away this share of it at most.
_MOST_TAKEN = 0.95


class BoundStep:
    """The step of the bound that belongs to a step of ``point``; made once for each tangent.

    Values are those of the nodes that take part, (k,).  ``accuracy`` is that of linear solves.
    """

    def __init__(self, point: ConePoint, bound: FrictionBound, accuracy: float) -> None:
        self._point, self._cones, self._accuracy = point, point.cones, accuracy
        self._bound = bound
        assert point.contact is not None and point.friction is not None
        self._contact, self._friction = point.contact, point.friction
        cones = self._cones
        mu, slope = bound.slope()
        pressure = cones.at_all_nodes(self._contact.z)
        smoothed = bound.smoothing.apply(pressure)
        known = float(bound.is_coulomb)
        wanted = mu * np.abs(smoothed) if bound.is_coulomb else bound.evaluate(pressure)
        self._wanted = wanted[cones.active]
        self._mu = known * mu[cones.active]
        slip = cones.slips(cones.system.u.x.array)
        size = np.sqrt(np.sum(slip**2, axis=0))
        self._along = slip / np.maximum(size, np.finfo(float).tiny)
        self._slope = known * (slope * np.abs(smoothed))[cones.active]

    def adapt(self, pressure_step: FloatArray, slip_step: FloatArray) -> None:
        """Set the step of the bound to what agrees with (dp, ds) and with itself; collective.

        The step (dp, ds) is one with the step of the bound that is set before.
        """
        friction = self._friction
        wanted = self._wanted + self._moved(pressure_step, slip_step)
        step = friction.bound_step + self._solve(wanted - friction.bound - friction.bound_step)
        friction.bound_step[:] = np.maximum(step, -_MOST_TAKEN * friction.bound)

    def _moved(self, pressure_step: FloatArray, slip_step: FloatArray) -> FloatArray:
        """``mu R dp + mu'(s) |R p| ds``."""
        cones = self._cones
        smoothed = self._bound.smoothing.apply(cones.at_all_nodes(pressure_step))[cones.active]
        along = np.einsum("ik,ik->k", self._along, slip_step)
        return np.asarray(self._mu * smoothed + self._slope * along)

    def _solve(self, right: FloatArray) -> FloatArray:
        comm = self._cones.comm
        size = ((len(right), None), (len(right), None))
        context = _Map(lambda b: b - self._moved(*self._point.response(b, self._accuracy)))
        matrix = PETSc.Mat().createPython(size, context, comm=comm)
        matrix.setUp()
        x, b = matrix.createVecs()
        b.array_w[:] = right
        ksp = PETSc.KSP().create(comm)
        ksp.setOptionsPrefix(_PREFIX)
        ksp.setType(PETSc.KSP.Type.GMRES)
        ksp.setOperators(matrix)
        ksp.getPC().setType(PETSc.PC.Type.NONE)
        ksp.setTolerances(rtol=_RTOL, max_it=_MAX_ITERATIONS)
        ksp.setGMRESRestart(_MAX_ITERATIONS)
        ksp.solve(b, x)
        step = x.array_r.copy()
        for item in (ksp, matrix, x, b):
            item.destroy()
        return step


class _Map:
    """A linear map of arrays as PETSc's shell matrix."""

    def __init__(self, apply: Callable[[FloatArray], FloatArray]) -> None:
        self._apply = apply

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array_w[:] = self._apply(x.array_r.copy())
