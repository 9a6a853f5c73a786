"""``kappa = c rho``: if it is below 1, no other displacement solves the problem on this mesh.

``c = max |v_tau| / |v|_a`` is over the displacements v that are zero on Gamma_D, and
``rho = max |w_g|_a / |g|`` over the values g at the nodes where friction acts, with the norms on
Gamma_C by the weights of the nodes.  w_g has ``w_nu = R* (mu g)`` and ``w_tau = 0`` on Gamma_C, is
zero on Gamma_D and in all cells that can lock, and has the least elastic energy of such fields.
The proof is in docs/certificate.md.
"""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la

from contact_locking.arrays import FloatArray
from contact_locking.certificate.elliptic import (
    EllipticProblem,
    NotApplicable,
    largest_eigenvalue,
    on_contacts,
    trace_norm,
    with_contacts_fixed,
)
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.fem.joint_forms import JointForm, action
from contact_locking.fem.trace import make_nodal
from contact_locking.mesh.rank_sums import marked
from contact_locking.parallel import on_any_rank

# A condition that holds more of a unit normal than this holds more than rounding.
_ROUNDING = 1e-9
# The share that two eigenvalues to a relative 1e-6 may lack, with room.
_MARGIN = 1e-4


@dataclass(frozen=True)
class Kappa:
    """``trace`` is c, and ``lift`` is rho, which has mu in it."""

    trace: float
    lift: float

    @property
    def value(self) -> float:
        return self.trace * self.lift

    def numbers(self) -> dict[str, float]:
        """The entries of summary.json."""
        return {"kappa": self.value, "c": self.trace, "rho": self.lift}

    @property
    def is_small(self) -> bool:
        """Whether kappa is below 1 by more than what the eigenvalue solver may lack."""
        return self.value < 1.0 - _MARGIN


def kappa(state: SolvedState, wanted: bool) -> Kappa:
    """The constants c and rho of all contacts together, by two eigenvalue problems; collective.

    Both come from below, to the accuracy of the eigenvalue solver.  Raises NotApplicable with the
    hypothesis of the proof that fails, and if nobody asks.
    """
    require_coulomb(state)
    problem, space = state.problem, state.problem.u.function_space
    if problem.data.own_energy is not None:
        raise NotApplicable("the body has an energy of the user's own")
    if problem.data.jumps:
        raise NotApplicable("two bodies touch")
    if problem.free or problem.sprung:
        raise NotApplicable("displacement conditions alone do not hold the body")
    rubbing = [item for item in problem.contacts if not item.friction.frictionless]
    if not rubbing:
        raise NotApplicable("there is no friction")
    if any(item.friction.depends_on_slip for item in rubbing):
        raise NotApplicable("the friction coefficient depends on the slip")
    lifts = _Lifts(state, rubbing)
    if not wanted:
        raise NotApplicable("certificate.constants is false")
    v, w = ufl.TestFunction(space), ufl.TrialFunction(space)
    slips = [[item.parts(item.limited(field))[1] for field in (v, w)] for item in rubbing]
    pairs = zip(rubbing, slips, strict=True)
    traces = sum(ufl.inner(*pair) * contact.surface.ds for contact, pair in pairs)
    trace = trace_norm(state, state.system.bilinear, traces)
    with closing(EllipticProblem(state, state.system.bilinear, lifts.constraints)) as elastic:
        return Kappa(trace, math.sqrt(lifts.largest_energy(elastic)))


def require_coulomb(state: SolvedState) -> None:
    """Raise NotApplicable unless friction is Coulomb's on foundations in a known place."""
    bounds = [contact.friction for contact in state.problem.contacts]
    if state.problem.data.tools:
        raise NotApplicable(
            "forces decide where a foundation is, and the slip is relative to its unknown travel"
        )
    if not all(bound.is_coulomb for bound in bounds):
        raise NotApplicable("the friction bound is the user's own")


class _Lifts:
    """The fields w_g for values g at the owned nodes of the contacts ``rubbing``.

    ``constraints`` hold Gamma_C and the cells that can lock.  The constructor is collective.
    Raises NotApplicable where a w_g is no displacement of the mesh.
    """

    def __init__(self, state: SolvedState, rubbing: list[NodalContact]) -> None:
        self._state, self._rubbing = state, rubbing
        given, space = state.problem.constraints, state.problem.u.function_space
        contacts = state.problem.contacts
        free = [np.repeat(item.free[:, None].astype(float), state.dim, axis=1) for item in contacts]
        acting = on_contacts(space, [item.surface for item in contacts], free).x.array
        locks = self._where_the_body_can_lock()
        if on_any_rank(state.comm, acting > 1.0):
            raise NotApplicable("friction or pressure of two contacts acts at one node")
        if on_any_rank(state.comm, (acting > 0.0) & (locks > 0.0)):
            raise NotApplicable("the body can lock beside Gamma_C")
        for contact in rubbing:
            normals = contact.surface.vector_function(contact.normals * contact.free[:, None])
            held = normals.x.array - given.free_part(normals.x.array)
            if on_any_rank(state.comm, np.abs(held) > _ROUNDING):
                raise NotApplicable("a displacement condition holds an oblique direction")
        self.constraints = with_contacts_fixed(state, locks)
        self._mu = [item.friction.coefficient(np.zeros(len(item.free))) for item in rubbing]
        self._lift = fem.Function(space)

    def largest_energy(self, problem: EllipticProblem) -> float:
        """``rho^2``, where ``problem`` is elastic with the constraints; collective."""
        roots = [np.sqrt(contact.surface.weights[contact.free]) for contact in self._rubbing]
        root = np.concatenate(roots)
        ends = np.cumsum([len(part) for part in roots])[:-1]
        form = JointForm(action(self._state.system.bilinear, self._lift))

        def apply(values: FloatArray) -> FloatArray:
            parts = np.split(values / root, ends)
            self._lift.x.array[:] = problem.solve(None, self._pushed(parts)).x.array
            return root * np.concatenate(self._carried(form))

        return largest_eigenvalue(self._state.comm, len(root), apply)

    def _pushed(self, parts: list[FloatArray]) -> fem.Function:
        """``R* (mu g) nu`` on Gamma_C for g at the nodes where friction acts; collective."""
        values, surfaces = [], [contact.surface for contact in self._rubbing]
        for contact, mu, part in zip(self._rubbing, self._mu, parts, strict=True):
            g = np.zeros(len(mu))
            g[contact.free] = part
            along = contact.rubbing(contact.friction.smoothing.adjoint(mu * g))
            values.append(along[:, None] * contact.normals)
        field = on_contacts(self._lift.function_space, surfaces, values)
        make_nodal(field, [surface.limited for surface in surfaces])
        return field

    def _carried(self, form: JointForm) -> list[FloatArray]:
        """``mu R s`` where friction acts, with the normal stresses s of w_g; collective."""
        space = self._lift.function_space
        forces = la.vector(space.dofmap.index_map, space.dofmap.index_map_bs)
        form.assemble_vector(forces)
        nodal, found = forces.array.reshape(-1, self._state.dim), []
        for contact, mu in zip(self._rubbing, self._mu, strict=True):
            surface = contact.surface
            limited = surface.limited.limited_forces(nodal[surface.blocks])
            normal = np.sum(limited * contact.normals, axis=1)
            stress = contact.acting(normal / surface.weights)
            found.append((mu * contact.friction.smoothing.apply(stress))[contact.free])
        return found

    def _where_the_body_can_lock(self) -> FloatArray:
        """1 at the local dofs of cells with a finite limit, and 0 elsewhere; collective."""
        state, space = self._state, self._state.problem.u.function_space
        points = state.points
        limits = [points.by_cell(np.isfinite(item.limit)).any(axis=1) for item in points.sets]
        cells = np.flatnonzero(np.any(limits, axis=0))
        locks = marked(space.dofmap.index_map, space.dofmap.list[cells])
        return np.repeat(locks.astype(float), state.dim)
