"""Semismooth Newton on (26) for one penalty and one friction bound, driven by PETSc's SNES.

At a fixed bound the residual is the gradient of a convex energy.  The step length is therefore
sought on the directional derivative, never on the residual norm (which must grow on the way
through a locking front) nor on the energy (which has no digits left near the minimum).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from contact_locking.errors import NotConverged, raise_callback_error
from contact_locking.fem.compiled import JointForm
from contact_locking.penalty_method.equations import Equations
from contact_locking.solver.ksp import InsertedOptions, LinearFailure, default_options
from contact_locking.solver.task import Counts, Task

# A step is long enough if it halves the slope of the energy; the trials of a length.
_SLOPE_SHARE, _MOST_TRIALS = 0.5, 30
# A residual this small (relative to the forces) that no longer shrinks may be rounding.
_SMALL = 1e-4


class CriticalPointStep:
    """A step of SNES, of its type python: the Newton direction, shortened to a critical point.

    With ``phi'(t) = -F(x - t y) . y`` the full step is taken if ``phi'(1) <= |phi'(0)|/2``, else
    the root of ``phi'`` in (0, 1) is bracketed until ``|phi'|`` has halved.
    """

    def __init__(self, counts: Counts) -> None:
        self._counts = counts

    def step(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set ``y`` to the step from ``x``, whose residual is ``f``; called by SNES."""
        matrix = snes.getJacobian()[0]
        snes.computeJacobian(x, matrix)
        snes.ksp.setOperators(matrix)
        snes.ksp.solve(f, y)
        self._counts.tangents += 1
        self._counts.linear += snes.ksp.getIterationNumber()
        y.scale(self._length(snes, x, f, y))

    def _length(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec, y: PETSc.Vec) -> float:
        start = -float(f.dot(y))
        if start == 0.0:
            # Nothing is unbalanced: loads on held nodes alone, for example.
            return 1.0
        if not start < 0.0:
            raise NotConverged("the tangent is not positive definite")
        trial, gradient = x.duplicate(), f.duplicate()

        def slope(t: float) -> float:
            trial.waxpy(-t, y, x)
            snes.computeFunction(trial, gradient)
            return -float(gradient.dot(y))

        try:
            return critical_point(slope, start)
        finally:
            trial.destroy()
            gradient.destroy()


def critical_point(slope: Callable[[float], float], start: float) -> float:
    """A t in (0, 1] with ``slope(t)`` at most half of ``|start|``, for ``slope(0) = start < 0``.

    It is 1 if the slope there is as small or negative; otherwise the Illinois variant of regula
    falsi finds t, for a slope that increases.
    """
    enough, last = _SLOPE_SHARE * abs(start), -1
    ends, slopes = [0.0, 1.0], [start, slope(1.0)]
    if slopes[1] <= enough:
        return 1.0
    for _ in range(_MOST_TRIALS):
        t = (ends[0] * slopes[1] - ends[1] * slopes[0]) / (slopes[1] - slopes[0])
        value = slope(t)
        if abs(value) <= enough:
            break
        side = int(value > 0.0)
        ends[side], slopes[side] = t, value
        slopes[1 - side] *= 0.5 if side == last else 1.0
        last = side
    return t


class Newton:
    """SNES on the equations of a task; keeps the matrix and its symbolic factorisation; collective.

    The displacement of the system is the start, and the solution afterwards.
    """

    def __init__(self, task: Task, equations: Equations) -> None:
        self._task, self._equations, self._system = task, equations, task.system
        system, settings, u = task.system, task.settings, task.system.u
        v, du = (make(u.function_space) for make in (ufl.TestFunction, ufl.TrialFunction))
        self._residual = JointForm(equations.residual(u, v))
        self._tangent = JointForm(equations.tangent(u, v, du))
        self._work, self._owned = fem.Function(u.function_space), len(system.load)
        self._matrix = self._tangent.create_matrix()
        motions = system.near_nullspace()
        self._matrix.setNearNullSpace(motions)
        motions.destroy()
        self._x, self._f = self._matrix.createVecRight(), self._matrix.createVecLeft()
        self._tolerance, self._last, self._least_steps = settings.tolerance, np.inf, 0
        self._snes = snes = PETSc.SNES().create(system.comm)
        snes.setFunction(lambda _, x, f: self._assemble_residual(x, f), self._f)
        snes.setJacobian(self._assemble_tangent, self._matrix)
        snes.setType(PETSc.SNES.Type.PYTHON)
        snes.setPythonContext(CriticalPointStep(task.counts))
        snes.ksp.setErrorIfNotConverged(True)
        defaults = default_options(settings.linear, system.dim, system.size, system.comm)
        # SNES's own divergence test takes the growth of the residual norm for divergence.
        defaults |= {"snes_divergence_tolerance": -1.0}
        self._options = InsertedOptions([snes, snes.ksp], defaults, settings.petsc)
        snes.setTolerances(max_it=settings.max_iterations)
        snes.setConvergenceTest(self._test)

    def solve(self, tolerance: float, least_steps: int = 0) -> None:
        """Solve from the system's displacement to ``|F| <= tolerance max(|f|, |a(u, .)|)``.

        ``least_steps`` are taken even if the start is good enough.  Raises NotConverged, with the
        displacement left as it was, if that is not reached.
        """
        self._tolerance, self._least_steps = tolerance, least_steps
        self._equations.refresh()
        self._x.array_w[:] = self._system.u.x.array[: self._owned]
        start, failure = self._x.copy(), None
        try:
            self._snes.solve(None, self._x)
            if (reason := self._snes.getConvergedReason()) < 0:
                failure = NotConverged(f"SNES stopped with reason {reason}")
        except PETSc.Error as error:
            failure = _failure(error)
        self._set_displacement(start if failure else self._x)
        start.destroy()
        if failure:
            raise failure

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._options.remove()
        for petsc_object in (self._snes, self._matrix, self._x, self._f):
            petsc_object.destroy()

    def _set_displacement(self, x: PETSc.Vec) -> None:
        """``u = x`` at free dofs, and the prescribed values at constrained dofs."""
        self._system.u.x.array[: self._owned] = x.array_r
        self._system.constraints.apply(self._system.u)

    def _assemble_residual(self, x: PETSc.Vec, f: PETSc.Vec) -> None:
        """The free part of (26)."""
        self._set_displacement(x)
        self._residual.assemble_vector(self._work.x)
        f.array_w[:] = self._system.constraints.free_part(self._work.x.array[: self._owned])

    def _assemble_tangent(
        self, _: PETSc.SNES, x: PETSc.Vec, matrix: PETSc.Mat, __: PETSc.Mat
    ) -> None:
        self._set_displacement(x)
        self._system.constraints.assemble_matrix(self._tangent, matrix)
        # PETSc forgets this with new values, and MUMPS would then look for pivots.
        matrix.setOption(PETSc.Mat.Option.SPD, True)

    def _test(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> PETSc.SNES.ConvergedReason | None:
        if iteration < self._least_steps:
            self._last = np.inf
            return None
        residual = norms[2]
        if not np.isfinite(residual):
            raise NotConverged("the residual is not finite")
        self._set_displacement(snes.getSolution())
        scale = self._system.force_scale(self._task.settings.tolerance)
        self._task.monitor.iteration(iteration, residual / scale if scale > 0.0 else residual)
        stalls = self._last < 2.0 * residual <= _SMALL * scale
        self._last = residual if iteration else np.inf
        if residual <= self._tolerance * scale or (stalls and residual <= self._rounding(snes)):
            return PETSc.SNES.ConvergedReason.CONVERGED_FNORM_ABS
        if iteration >= snes.getTolerances()[3]:
            raise NotConverged("too many Newton steps")
        return None

    def _rounding(self, snes: PETSc.SNES) -> float:
        """Five times the change of the residual by one last digit of the displacement."""
        x, f = snes.getSolution().copy(), self._f.duplicate()
        signs = np.random.default_rng(0).choice([-1.0, 1.0], x.getLocalSize())
        x.array_w[:] *= 1.0 + np.finfo(float).eps * signs
        self._assemble_residual(x, f)
        f.axpy(-1.0, snes.getFunction()[0])
        noise = float(f.norm())
        x.destroy()
        f.destroy()
        return 5.0 * noise


def _failure(error: PETSc.Error) -> NotConverged:
    """Why PETSc gave up; what a callback raised is raised again unless it is numerical."""
    raise_callback_error(error)
    cause: BaseException | None = error
    while isinstance(cause, PETSc.Error):
        cause = cause.__cause__
    return LinearFailure() if cause is None else NotConverged(str(cause))
