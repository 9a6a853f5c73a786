"""Equilibrium of every free node, and balance of all forces and moments on the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import ufl
from dolfinx import fem

from contact_locking.arrays import FloatArray, moments
from contact_locking.certificate.solved_state import Criterion, SolvedState, reactions_by_part
from contact_locking.fem import compiled
from contact_locking.problem import forms
from contact_locking.problem.rounding import ROUNDING

# The residuals of the free nodes, up to the tolerance of the solver, may add up in the sum of all
# forces and moments.  The limit of a balance is this multiple of the tolerance.
_BALANCE_SHARE = 10.0


@dataclass(frozen=True)
class Equilibrium:
    """Resultants on the body, (d,) each, and its balances.

    ``reactions_by_part`` has the reactions of each boundary part with prescribed displacements or
    springs, whose forces are reactions.

    ``residual`` is ``|a(u, v) + (Z, eps(v)) + int p v_nu - int sigma_tau . v_tau - (f, v)|`` over
    the free dofs, divided by the larger of the norms of ``(f, v)`` and ``a(u, v)`` over all dofs.
    ``force`` and ``moment`` are the sums of loads, contact forces and reactions.  The force is
    relative to the largest of the three sums of nodal force magnitudes, and the moment to this sum
    times the extent of the body.  Forces as small as the rounding in ``u``, or in the reactions,
    which a strain beyond its limit makes large, count as zero.  The forces of a user's own energy
    take part in all three.  ``tools`` has for each free motion m of a foundation
    ``|F - k q - int (sigma_tau - p nu) . m|`` relative to F or to the integral of the magnitudes.

    The radial forces on an axisymmetric body balance by symmetry, and have no resultant.  The force
    along the axis alone is balanced then, and ``moment`` is None.
    """

    residual: float
    force: float
    moment: float | None
    loads: FloatArray
    contact: FloatArray
    reactions: FloatArray
    reactions_by_part: dict[str, FloatArray]
    tools: tuple[float, ...]

    def criteria(self, tolerance: float) -> dict[str, Criterion]:
        share = _BALANCE_SHARE * tolerance
        criteria = {
            "equilibrium": Criterion(self.residual, tolerance, "equilibrium residual"),
            "force_balance": Criterion(self.force, share, "sum of all forces on the body"),
        }
        if self.moment is not None:
            meaning = "sum of all moments on the body"
            criteria["moment_balance"] = Criterion(self.moment, share, meaning)
        if self.tools:
            imbalance = max(self.tools)
            criteria["tool_balance"] = Criterion(
                imbalance, share, "imbalance of the forces on a tool"
            )
        return criteria


class NodalForces(NamedTuple):
    """Loads, elastic forces, and forces of contact and of a user's own energy, at the local dofs.

    ``left`` are the forces that the reactions balance, zero at free dofs in equilibrium.
    """

    load: FloatArray
    elastic: FloatArray
    touching: FloatArray
    own: FloatArray
    left: FloatArray


def nodal_forces(state: SolvedState) -> NodalForces:
    """The forces of the stored stress, pressure and traction, and the loads; collective.

    The contact forces are sums over the nodes with the nodal weights.  They do not use the solver's
    forms of contact, so that a wrong sign in either place shows.  Loads and elastic forces are the
    forms of the solver.
    """
    u, data = state.problem.u, state.problem.data
    v = ufl.TestFunction(u.function_space)
    load, elastic = state.system.forms.loads(), state.system.forms.elastic_forces(u)

    def compile_stress() -> tuple[fem.Function, fem.Form]:
        stress = fem.Function(state.body.locking_stress.function_space)
        return stress, compiled.form(ufl.inner(stress, data.strain(v)) * data.locking_dx)

    stress, of_stress = state.system.kept("locking stress", compile_stress)
    stress.x.array[:] = state.body.locking_stress.x.array
    of_energy, touching = np.zeros_like(load), np.zeros_like(load)
    if data.own_energy is not None:
        of_energy = -compiled.assembled(forms.own_forces(u, v, data))
    for contact in state.contacts:
        tractions = contact.traction - contact.pressure[:, None] * contact.normal
        touching += contact.surface.nodal_forces(tractions)
    reacting = elastic + compiled.assembled(of_stress) - of_energy - load - touching
    return NodalForces(load, elastic, touching, of_energy, reacting)


def equilibrium(state: SolvedState) -> Equilibrium:
    """Balance the stored stress, pressure and traction with the loads; collective."""
    space, constraints = state.problem.u.function_space, state.problem.constraints
    load, elastic, touching, of_energy, balanced = nodal_forces(state)
    owned = len(state.system.load)
    reaction, unbalanced = (
        constraints.held_part(balanced[:owned]),
        constraints.free_part(balanced[:owned]),
    )

    def norm(vector: FloatArray) -> float:
        return float(np.sqrt(state.sum(vector[:owned] ** 2)))

    rounding = max(state.system.rounding.in_forces(), ROUNDING * norm(reaction))
    tolerance = state.settings.tolerance
    scale = max(norm(load), norm(elastic), rounding / tolerance) or 1.0
    x = space.tabulate_dof_coordinates()[: owned // state.dim, : state.dim]
    total, magnitude, moment = [], 0.0, 0.0
    centre = state.comm.allreduce(x.sum(axis=0)) / state.comm.allreduce(len(x))
    of_springs = [
        (spring.on, spring.forces(state.problem.u)) for spring in state.problem.data.springs
    ]
    sprung = sum((forces for _, forces in of_springs), np.zeros_like(load))
    reacting = sprung[:owned] + reaction
    # A user's own energy may also act from outside.
    for vector in (load, touching, reacting, of_energy):
        nodal = vector[:owned].reshape(-1, state.dim)
        total.append(state.comm.allreduce(nodal.sum(axis=0)))
        if vector is not of_energy:
            magnitude = max(magnitude, state.sum(np.linalg.norm(nodal, axis=1)))
        turning = moments(x - centre, nodal).sum(axis=0)
        moment = moment + state.comm.allreduce(turning)
    # At rest and in a rigid motion all forces are rounding, whose sums must not fail the balances.
    count = np.sqrt(state.comm.allreduce(owned))
    size = max(magnitude, count * rounding / (_BALANCE_SHARE * tolerance)) or 1.0
    axisymmetric = state.problem.domain.axisymmetric
    resultant = np.sum(total, axis=0)[1 if axisymmetric else 0 :]
    turning = float(np.linalg.norm(moment)) / (size * state.target.length)
    by_part = reactions_by_part(state.problem.domain, constraints, reaction)
    for name, forces in of_springs:
        force = state.comm.allreduce(forces[:owned].reshape(-1, state.dim).sum(axis=0))
        by_part[name] = by_part.get(name, 0.0) + force
    return Equilibrium(
        residual=norm(unbalanced) / scale,
        force=float(np.linalg.norm(resultant)) / size,
        moment=None if axisymmetric else turning,
        loads=total[0],
        contact=total[1],
        reactions=total[2],
        reactions_by_part=by_part,
        tools=_tool_balances(state, rounding / tolerance),
    )


def _tool_balances(state: SolvedState, least: float) -> tuple[float, ...]:
    """The share of the forces along each free motion that nothing balances; collective.

    ``least`` is the force below which forces are rounding.
    """
    of_contact = {id(fields.contact): fields for fields in state.contacts}
    shares = []
    tools = state.system.tools
    for tool, force in zip(tools, tools.left, strict=True):
        fields = of_contact[id(tool.contact)]
        resultant, magnitude = tool.resultant(fields.pressure, fields.traction)
        imbalance = abs(float(force) - resultant)
        size = max(abs(tool.force), magnitude, least)
        shares.append(imbalance / size if size > 0.0 else imbalance)
    return tuple(shares)
