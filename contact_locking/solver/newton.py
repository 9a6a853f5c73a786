"""Semismooth Newton on (26) for one penalty and one friction bound, driven by PETSc's SNES.

At a frozen bound the residual is the gradient of a convex energy.  The step length is therefore
sought on the directional derivative, never on the residual norm (which must grow on the way
through a locking front) nor on the energy (which has no digits left near the minimum).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from petsc4py import PETSc

from contact_locking.errors import NotConverged, raise_callback_error
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.linear.border import Border
from contact_locking.solver.linear.ksp import (
    LINEAR_FAILURE,
    IterationListener,
    configure,
    default_options,
    is_direct,
)
from contact_locking.solver.task import Task


class ToolBorder:
    """Solves ``(K - B C^-1 B^T) y = f``, the tangent of (25) where tools are in equilibrium.

    K is the tangent with tools that stand still, and tools move by ``-C^-1 B^T y`` (Tools).
    """

    def __init__(self, system: PenalisedSystem, ksp: PETSc.KSP, matrix: PETSc.Mat) -> None:
        self._system, self._ksp = system, ksp
        self._border = Border(len(system.tools), matrix.createVecRight)

    def refresh(self) -> None:
        """Take the tangent of the system at its present displacement; collective."""
        system, corners, columns = self._system, [], iter(self._border.columns)
        if not system.tools:
            return
        # The tangent has this stiffness beside that of the contact law.
        floor = system.CONTACT_FLOOR / float(system.data.epsilon.value)
        floor *= float(system.held_by_contact)
        for surface, tractions, corner in system.tools.borders(system.u, floor):
            corners.append(corner)
            column, forces = next(columns), surface.nodal_forces(tractions)
            column.array_w[:] = system.constraints.free_part(forces[: column.getLocalSize()])
        self._border.refresh(np.diag(corners), self._ksp.solve)

    def solve(self, f: PETSc.Vec, y: PETSc.Vec) -> None:
        """Solve for y; collective."""
        self._ksp.solve(f, y)
        self._border.solve(y, [0.0] * len(self._system.tools))

    def destroy(self) -> None:
        """Free the PETSc objects, and the reference to the solver; collective."""
        self._border.destroy()
        self._ksp.destroy()


ConvergedReason = PETSc.SNES.ConvergedReason

# A residual this small (relative to the forces) that no longer shrinks may be rounding.
_SMALL = 1e-4
# Full steps that lead to the end leave a residual (relative to the forces) of 50 and of 0.016 at
# most after the first and the second of them; most of those that do not leave thousands at once.
_ARRIVES = {1: 100.0, 2: 0.02}
# If at most _FEW_LEFT steps may follow the second step, the second step has to leave _SOON times
# the residual above at most.
_FEW_LEFT, _SOON = 2, 0.1


class CriticalPointStep:
    """A SNES step of type python: the Newton direction, shortened to a critical point.

    With ``phi'(t) = -F(x - t y) . y`` the full step is taken if ``phi'(1) <= |phi'(0)|/2``, else
    the root of ``phi'`` in (0, 1) is bracketed until ``|phi'|`` has halved.  ``always_full`` steps
    are not shortened.  ``keep_tangent`` lets the next step use the tangent of the last.
    """

    SLOPE_SHARE = 0.5
    MAX_TRIALS = 30

    def __init__(
        self,
        counted: Callable[[int, int], None],
        kept: Callable[[Callable[..., None]], Callable[..., None]],
        border: ToolBorder,
        always_full: bool,
    ) -> None:
        self._counted, self._border, self._always_full = counted, border, always_full
        self.keep_tangent = False
        self.step = kept(self._step)

    def _step(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec, y: PETSc.Vec) -> None:
        is_new, self.keep_tangent = not self.keep_tangent, False
        if is_new:
            matrix = snes.getJacobian()[0]
            snes.computeJacobian(x, matrix)
            snes.ksp.setOperators(matrix)
            self._border.refresh()
        self._border.solve(f, y)
        self._counted(int(is_new), snes.ksp.getIterationNumber())
        if not self._always_full:
            y.scale(self._length(snes, x, f, y))

    def _length(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec, y: PETSc.Vec) -> float:
        start = -f.dot(y)
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
            end = slope(1.0)
            if end <= self.SLOPE_SHARE * abs(start):
                return 1.0
            return self._root(slope, start, end)
        finally:
            trial.destroy()
            gradient.destroy()

    def _root(self, slope: Callable[[float], float], start: float, end: float) -> float:
        """The Illinois variant of regula falsi on (0, 1), for ``start < 0 < end``."""
        low, high, at_low, at_high = 0.0, 1.0, start, end
        side = 0
        t = 1.0
        for _ in range(self.MAX_TRIALS):
            t = (low * at_high - high * at_low) / (at_high - at_low)
            value = slope(t)
            if abs(value) <= self.SLOPE_SHARE * abs(start):
                break
            if value < 0.0:
                low, at_low = t, value
                at_high *= 0.5 if side == -1 else 1.0
                side = -1
            else:
                high, at_high = t, value
                at_low *= 0.5 if side == 1 else 1.0
                side = 1
        return t


class NewtonSolver:
    """SNES over the system of a task; keeps the matrix and its symbolic factorisation.

    Where the start is ``near`` the solution, cells and nodes at the edge of locking and contact
    change sides at once: a line search would stop at every kink, while two full steps put them
    right, or it gives up.  The tangent at the end is then good enough for the first step after
    a change of the friction bound.  ``arrives`` holds the residuals (relative to the forces)
    above which it gives up after so many steps.  A ``direct`` solver of another method is used
    with its matrix.
    """

    def __init__(
        self,
        task: Task,
        near: bool = False,
        direct: PETSc.KSP | None = None,
        arrives: Mapping[int, float] = _ARRIVES,
    ) -> None:
        self._task, self._near, self._arrives = task, near, arrives
        system, settings = task.system, task.settings
        self._system = system
        self._matrix = system.create_matrix() if direct is None else direct.getOperators()[0]
        self._x, self._f = self._matrix.createVecRight(), self._matrix.createVecLeft()
        self._tolerance, self._last, self._least_steps = settings.tolerance, np.inf, 0
        self._raised: BaseException | None = None
        self._snes = snes = PETSc.SNES().create(system.comm)
        snes.setFunction(self._kept(lambda _, x, f: system.residual(x, f)), self._f)
        snes.setJacobian(self._kept(self._assemble), self._matrix)
        snes.setType(PETSc.SNES.Type.PYTHON)
        if direct is not None:
            snes.setKSP(direct)
        self._border = ToolBorder(system, snes.ksp, self._matrix)
        self._step = CriticalPointStep(self._count, self._kept, self._border, near)
        snes.setPythonContext(self._step)
        snes.ksp.setErrorIfNotConverged(True)
        iterates = not is_direct(settings.linear, system.dim, system.size)
        self._listeners = [IterationListener(snes.ksp, task.monitor.linear)] if iterates else []
        defaults = default_options(settings.linear, system.dim, system.size, system.comm)
        # SNES's own divergence test takes the growth of the residual norm for divergence.
        defaults |= {"snes_divergence_tolerance": -1.0}
        self._options = configure([snes, snes.ksp], defaults, settings.petsc)
        snes.setTolerances(max_it=settings.max_iterations)
        snes.setConvergenceTest(self._kept(self._test))

    def solve(self, tolerance: float, least_steps: int = 0) -> None:
        """Solve from the system's displacement to ``|F| <= tolerance max(|f|, |a(u, .)|)``.

        ``least_steps`` are taken even if the start is good enough.  Raises NotConverged, with the
        displacement left as it was, if that is not reached.
        """
        self._tolerance, self._least_steps = tolerance, least_steps
        self._raised = None
        self._system.displacement(self._x)
        start = self._x.copy()
        reason = None
        try:
            self._snes.solve(None, self._x)
            self._raise_kept()
            reason = self._snes.getConvergedReason()
        except PETSc.Error as error:
            failure = self._failure(error)
        else:
            is_long = reason == ConvergedReason.DIVERGED_MAX_IT
            failure = "too many Newton steps" if is_long else f"SNES stopped with reason {reason}"
        if reason is None or reason < 0:
            self._system.set_displacement(start)
            start.destroy()
            raise NotConverged(failure)
        start.destroy()
        self._step.keep_tangent = self._near and self._snes.getIterationNumber() > 0
        self._system.set_displacement(self._x)

    def step(self) -> None:
        """Take one full step from the system's displacement; raises NotConverged; collective."""
        self._raised = None
        change, ksp = self._x.duplicate(), self._snes.ksp
        self._system.displacement(self._x)
        self._system.residual(self._x, self._f)
        self._system.tangent(self._x, self._matrix)
        try:
            ksp.setOperators(self._matrix)
            self._border.refresh()
            self._border.solve(self._f, change)
            self._raise_kept()
        except PETSc.Error as error:
            raise_callback_error(error)
            raise NotConverged(LINEAR_FAILURE) from None
        else:
            self._count(1, ksp.getIterationNumber())
            self._x.axpy(-1.0, change)
            self._system.set_displacement(self._x)
        finally:
            change.destroy()

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._options.remove()
        self._border.destroy()
        for item in (self._snes, self._matrix, self._x, self._f):
            item.destroy()

    def _kept(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """The callback, with what it raises kept: PETSc passes on an error code only."""

        def call(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except PETSc.Error:
                raise
            except BaseException as error:
                self._raised = error
                raise

        return call

    def _failure(self, error: PETSc.Error) -> str:
        """Why PETSc gave up; what a callback raised is raised again unless it is NotConverged."""
        raise_callback_error(error)
        if self._raised is not None and not isinstance(self._raised, NotConverged):
            raise self._raised from None
        return str(self._raised or LINEAR_FAILURE)

    def _raise_kept(self) -> None:
        for listener in self._listeners:
            listener.raise_kept()

    def _count(self, tangents: int, iterations: int) -> None:
        self._task.counts.tangents += tangents
        self._task.counts.linear += iterations

    def _assemble(self, _: PETSc.SNES, x: PETSc.Vec, matrix: PETSc.Mat, __: PETSc.Mat) -> None:
        self._system.tangent(x, matrix)

    def _test(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> PETSc.SNES.ConvergedReason | None:
        self._raise_kept()
        if iteration < self._least_steps:
            self._last = np.inf
            return None
        residual = norms[2]
        if not np.isfinite(residual):
            raise NotConverged("the residual is not finite")
        self._system.set_displacement(snes.getSolution())
        scale = self._system.force_scale(self._task.settings.tolerance)
        self._task.monitor.iteration(iteration, residual / scale if scale > 0.0 else residual)
        stalls = self._last < 2.0 * residual <= _SMALL * scale
        self._last = residual if iteration else np.inf
        if residual <= self._tolerance * scale or (stalls and residual <= self._rounding(snes)):
            return ConvergedReason.CONVERGED_FNORM_ABS
        limit = snes.getTolerances()[3]
        is_nearly_over = iteration == 2 and limit - iteration <= _FEW_LEFT
        share = _SOON if is_nearly_over else 1.0
        if self._near and residual > share * self._arrives.get(iteration, np.inf) * scale:
            raise NotConverged("the start is too far away")
        if iteration >= limit:
            return ConvergedReason.DIVERGED_MAX_IT
        return None

    def _rounding(self, snes: PETSc.SNES) -> float:
        """Five times the change of the residual by one last digit of the displacement."""
        x, f = snes.getSolution().copy(), self._f.duplicate()
        signs = np.random.default_rng(0).choice([-1.0, 1.0], x.getLocalSize())
        x.array_w[:] *= 1.0 + np.finfo(float).eps * signs
        self._system.residual(x, f)
        f.axpy(-1.0, snes.getFunction()[0])
        noise = float(f.norm())
        x.destroy()
        f.destroy()
        return 5.0 * noise
