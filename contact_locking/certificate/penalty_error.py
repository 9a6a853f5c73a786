"""A bound of the distance between the penalised solution and that of the inequality."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.certificate.solved_state import SetAtPoints, SolvedState
from contact_locking.contact.surface import ContactSurface
from contact_locking.errors import raise_callback_error
from contact_locking.fem.compiled import JointForm
from contact_locking.fem.spaces import make_nodal
from contact_locking.parallel import maximum, minimum, on_any_rank, on_every_rank
from contact_locking.solver.ksp import create_ksp, default_options, destroy_ksp
from contact_locking.supports.conditions import Constraints

# The prefix of PETSc options for these solves.
_PREFIX = "contact_locking_certificate_"
# The tolerance of CG.
_RTOL = 1e-8
# Rounding in strains and displacements, relative to the limit and to the body.
_ROUNDING = 1e-12
# The rounding in w_nu - gap after the penetration is subtracted, relative to the body.
_ENTRY_ROUNDING = 1e-10


class NotApplicable(Exception):
    """A part of the certificate does not apply to this problem; the message says why."""


def require_still_foundations(state: SolvedState) -> None:
    """Raise NotApplicable if a foundation is pushed by a force, or is another body."""
    if state.problem.data.is_paired:
        raise NotApplicable("two bodies touch; the proof needs foundations at known positions")
    if state.problem.data.tools:
        raise NotApplicable(
            "a force moves a foundation; the proof needs foundations at known positions"
        )


class EllipticProblem:
    """``b(z, v) = r(v)`` for all v that are zero at held dofs; all methods are collective.

    Arrays are local values of the displacement space, ghosts included.
    """

    def __init__(self, state: SolvedState, bilinear: Expr, constraints: Constraints) -> None:
        self._space = state.problem.u.function_space
        self._owned = self._space.dofmap.index_map.size_local * self._space.dofmap.index_map_bs
        self._bilinear, self._kept = bilinear, state.system.kept
        self._constraints = constraints
        form = self._kept(("certificate", bilinear), lambda: JointForm(bilinear, self._kept.form))
        self.matrix = form.create_matrix()
        constraints.assemble_matrix(form, self.matrix)
        self.matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._nullspace = state.system.near_nullspace()
        self.matrix.setNearNullSpace(self._nullspace)
        options = default_options(state.settings.linear, state.dim, state.system.size, state.comm)
        self.ksp = create_ksp(state.comm, options | {"ksp_rtol": _RTOL}, prefix=_PREFIX)
        self.ksp.setOperators(self.matrix)

    def solve(
        self, right: FloatArray | None = None, values: fem.Function | None = None
    ) -> fem.Function:
        """The z with ``b(z, v) = r(v)`` and the held part of ``values``; collective.

        ``right`` are the nodal forces r.  Without ``values`` the held part is zero.  Raises
        NotApplicable if the linear solver fails.
        """
        solution = fem.Function(self._space)
        forces = np.zeros(self._owned) if right is None else right[: self._owned]
        prescribed = None if values is None else self._constraints.held_part(values.x.array)
        if prescribed is not None and on_any_rank(self._space.mesh.comm, prescribed != 0.0):
            held, carried = self._kept(("certificate of held", self._bilinear), self._action)
            solution.x.array[:] = held.x.array[:] = prescribed
            vector = la.vector(self._space.dofmap.index_map, self._space.dofmap.index_map_bs)
            carried.assemble_vector(vector)
            forces = forces - vector.array[: self._owned]
        b, x = self.matrix.createVecLeft(), self.matrix.createVecRight()
        b.array_w[:] = self._constraints.free_part(forces)
        try:
            self.ksp.solve(b, x)
        except PETSc.Error as error:
            raise_callback_error(error)
            raise NotApplicable("a linear solve failed") from error
        # CG may change the held part.
        solution.x.array[: self._owned] += self._constraints.free_part(x.array_r)
        solution.x.scatter_forward()
        for petsc_vector in (b, x):
            petsc_vector.destroy()
        return solution

    def close(self) -> None:
        destroy_ksp(self.ksp)
        for petsc_object in (self.matrix, self._nullspace):
            petsc_object.destroy()

    def _action(self) -> tuple[fem.Function, JointForm]:
        held = fem.Function(self._space)
        return held, JointForm(ufl.action(self._bilinear, held))


def on_contacts(
    space: fem.FunctionSpace, surfaces: Sequence[ContactSurface], values: Iterable[FloatArray]
) -> fem.Function:
    """The sum of the fields with limited values (k, d) at the nodes of each surface; collective."""
    field = fem.Function(space)
    for surface, nodal in zip(surfaces, values, strict=True):
        field.x.array[:] += surface.vector_function(nodal).x.array
    return field


def with_contacts_fixed(state: SolvedState, dofs: FloatArray | float = 0.0) -> Constraints:
    """The constraints, with all of Gamma_C and the nodes where ``dofs`` are 1 fixed; collective."""
    space, surfaces = state.problem.u.function_space, [c.surface for c in state.contacts]
    ones = [np.ones_like(fields.normal) for fields in state.contacts]
    marks = on_contacts(space, surfaces, ones).x.array + dofs
    nodes = np.flatnonzero(marks.reshape(-1, state.dim)[:, 0] > 0.0).astype(np.int32)
    return state.problem.constraints.with_fixed(nodes)


class Lifting:
    """Elastic fields with given values on Gamma_C and Gamma_D, by one factorisation.

    In proofs they replace the test function ``v = 0`` where 0 is not admissible.  A field w is
    admissible if it has the prescribed values on Gamma_D, ``w_nu <= gap`` on Gamma_C, and strains
    in all sets, ``|eps(w)| <= M``.  With friction w must not slip either: ``w_tau = 0`` on Gamma_C.
    :meth:`close` is collective.
    """

    def __init__(self, state: SolvedState) -> None:
        self._state = state
        self._surfaces = [fields.surface for fields in state.contacts]
        self._problem: EllipticProblem | None = None

    @cached_property
    def admissible(self) -> fem.Function | None:
        """An admissible field without slip, None for the zero field; collective.

        The field has the prescribed values on Gamma_D, ``w = min(gap, 0) nu`` on Gamma_C, and the
        least elastic energy.  Raises NotApplicable if its strain exceeds the locking limit, if
        values prescribed at nodes of Gamma_C slip or enter the foundation, and for a user's own
        energy, which no proof covers.
        """
        state, constraints = self._state, self._state.problem.constraints
        if state.problem.data.own_energy is not None:
            raise NotApplicable("no proof covers a user-defined energy")
        overlaps = any(np.any(fields.gap < 0.0) for fields in state.contacts)
        if on_every_rank(state.comm, constraints.largest() == 0.0 and not overlaps):
            return None
        # At a node of two contacts the values add up, and the check below judges the sum.
        prescribed = self._along_normals([np.minimum(f.gap, 0.0) for f in state.contacts])
        constraints.apply(prescribed)
        make_nodal(prescribed, [surface.controls for surface in self._surfaces])
        constraints.apply(prescribed)
        lifted = self._elastic(prescribed)
        self._check(lifted)
        return lifted

    def push_back(self) -> fem.Function:
        """``c = [u_nu - gap]^+ nu`` on Gamma_C, summed over the contacts, and 0 on Gamma_D."""
        state, constraints = self._state, self._state.problem.constraints
        entered = [np.maximum(f.u_normal - f.gap, 0.0) for f in state.contacts]
        values = self._along_normals(entered)
        values.x.array[:] = constraints.free_part(values.x.array)
        make_nodal(values, [surface.controls for surface in self._surfaces])
        values.x.array[:] = constraints.free_part(values.x.array)
        anywhere = on_any_rank(state.comm, any(np.any(depth > 0.0) for depth in entered))
        return self._elastic(values) if anywhere else values

    def close(self) -> None:
        if self._problem is not None:
            self._problem.close()

    def _along_normals(self, lengths: list[FloatArray]) -> fem.Function:
        pairs = zip(lengths, self._state.contacts, strict=True)
        values = [length[:, None] * fields.normal for length, fields in pairs]
        return on_contacts(self._state.problem.u.function_space, self._surfaces, values)

    def _elastic(self, values: fem.Function) -> fem.Function:
        if self._problem is None:
            constraints = with_contacts_fixed(self._state)
            self._problem = EllipticProblem(self._state, self._state.system.bilinear, constraints)
        return self._problem.solve(None, values)

    def _check(self, lifted: fem.Function) -> None:
        state = self._state
        sets = state.points.sets
        excesses = [law.reach(law.measured(lifted)) - law.limit * (1.0 + _ROUNDING) for law in sets]
        if not all([self._nowhere(excess) for excess in excesses]):
            raise NotApplicable(
                "the elastic displacement with the prescribed values exceeds the locking limit, "
                "and no other admissible field is known"
            )
        small = _ROUNDING * state.target.length
        for fields in state.contacts:
            normal, tangential = fields.contact.split(lifted)
            slip = np.linalg.norm(tangential, axis=1)
            if not self._nowhere(normal - fields.gap - small):
                raise NotApplicable(
                    "prescribed displacements at the edge of Gamma_C exceed the gap"
                )
            if not fields.contact.friction.frictionless and not self._nowhere(slip - small):
                raise NotApplicable("prescribed displacements at the edge of Gamma_C slip")

    def _nowhere(self, values: FloatArray) -> bool:
        """Whether no value on any rank is positive; collective."""
        return not on_any_rank(self._state.comm, values > 0.0)


def penalty_error(state: SolvedState, lifting: Lifting) -> dict[str, Any]:
    """``a(u - u*, u - u*)/2 <= eta^2``, where u* solves (19) on this mesh with G kept fixed.

    For an admissible field w (``|eps(w)| <= M``, ``w_nu <= gap``), and with Z, p and
    ``t = -sigma_tau`` of the penalised solution u, summed over all sets of strains,

        eta^2 = a(w - u, w - u)/2 + int (M |Z| - Z : eps(w)) + int p (gap - w_nu)
                + int (G |w_tau - u_old| - t . (w_tau - u_old)).

    The proof, and how w is found, are in docs/notes/bounds.md.  Returns ``energy_norm``, a bound of
    ``sqrt(a(u - u*, u - u*))``; ``relative``, this bound over the energy norm of u; and
    ``displacement_norm``, a bound of ``|u - u*|_V``; or None with a ``reason``.  Collective; takes
    one factorisation.
    """
    target = state.target
    if target.penalty.is_inequality:
        return {"energy_norm": 0.0, "relative": 0.0, "displacement_norm": 0.0}
    try:
        if not state.report.converged:
            raise NotApplicable("the solve did not converge")
        require_still_foundations(state)
        w = admissible_neighbour(state, lifting)
    except NotApplicable as failure:
        none = dict.fromkeys(("energy_norm", "relative", "displacement_norm"))
        return {**none, "reason": str(failure)}
    bound = float(np.sqrt(2.0 * _gap(state, w)))
    return {
        "energy_norm": bound,
        "relative": state.relative(bound),
        "displacement_norm": bound / float(np.sqrt(state.problem.material.ellipticity)),
    }


def admissible_neighbour(state: SolvedState, lifting: Lifting) -> fem.Function:
    """``w = w_0 + theta (u - c - w_0)`` with the largest theta in [0, 1] and ``|eps(w)| <= M``.

    Collective.  Raises NotApplicable if there is no such field.
    """
    start, back = lifting.admissible, lifting.push_back()
    w = fem.Function(back.function_space)
    w.x.array[:] = state.problem.u.x.array - back.x.array
    enters = [float(np.max(f.contact.split(w)[0] - f.gap, initial=0.0)) for f in state.contacts]
    if maximum(state.comm, max(enters, default=0.0)) > _ENTRY_ROUNDING * state.target.length:
        raise NotApplicable("prescribed displacements at the edge of Gamma_C enter the foundation")
    theta = 1.0
    for law in state.points.sets:
        b = law.measured(w)
        a = np.zeros_like(b) if start is None else law.measured(start)
        theta = min(theta, _longest_step(law, a, b - a))
    theta = minimum(state.comm, theta)
    w.x.array[:] *= theta
    if start is not None:
        w.x.array[:] += (1.0 - theta) * start.x.array
    return w


def energy_distance(state: SolvedState, w: fem.Function) -> float:
    """``sqrt(a(w - u, w - u))`` for the displacement u of the state; collective."""
    u = state.problem.u
    step = fem.Function(u.function_space)
    step.x.array[:] = w.x.array - u.x.array
    return float(np.sqrt(2.0 * state.system.forms.energy(step)))


def _longest_step(law: SetAtPoints, a: FloatArray, b: FloatArray) -> float:
    """The largest theta in [0, 1] with ``a + theta b`` in the set at all points; a is in it."""
    locks = np.isfinite(law.limit)
    a, b, limit = a[locks], b[locks], law.limit[locks]
    if a.ndim == 1:
        room = np.maximum(limit - a, 0.0)
        steps = np.divide(room, b, out=np.ones_like(b), where=b > 0.0)
        return float(min(1.0, steps.min(initial=1.0)))
    aa, ab, bb = (np.einsum("kij,kij->k", *pair) for pair in ((a, a), (a, b), (b, b)))
    room = np.maximum(limit**2 - aa, 0.0)
    # The positive root of bb theta^2 + 2 ab theta = room, without cancellation.
    root = np.sqrt(ab**2 + bb * room)
    bottom = np.where(ab > 0.0, ab + root, bb)
    top = np.where(ab > 0.0, room, root - ab)
    steps = np.divide(top, bottom, out=np.ones_like(top), where=bottom > 0.0)
    return float(min(1.0, steps.min(initial=1.0)))


def _gap(state: SolvedState, w: fem.Function) -> float:
    """``eta^2`` of :func:`penalty_error`; collective."""
    points = state.points
    total = 0.5 * energy_distance(state, w) ** 2
    for law in points.sets:
        work = law.work(law.measured(w))
        total += state.sum(points.weights * (law.support - work))
    for fields in state.contacts:
        normal, slip = fields.contact.split(w)[0], fields.contact.increment(w)
        work = np.sum(fields.traction * slip, axis=1)
        friction = fields.bound * np.linalg.norm(slip, axis=1) + work
        opening = fields.pressure * (fields.gap - normal)
        total += state.sum(fields.surface.weights * (opening + friction))
    return max(total, 0.0)
