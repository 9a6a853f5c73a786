"""Equilibrium of every free node, balance of forces and moments, and the energy balance of a step.

The energy balance of a step is about the numerical dissipation ``N_k = W_k - (E_k - E_{k-1}) -
D_k``, with the work W_k of the loads, the stored energy E_k and the dissipation D_k by friction.
docs/guides/steps.md has its bounds and their proof.

If bodies are paired anew in a step, W_k contains the change of the opening ``h_k`` by the new
pairing.  The lower bound still holds.  The upper bound needs both states in one pairing and is
omitted.

The forces of an eigenstrain eps_0 act at the nodes as loads do: the bounds count their work, and
``a(u, u)/2`` as the energy.  The history has the elastic energy ``A(eps - eps_0)^2/2`` instead, and
the work of everything else and of the change ``e`` of eps_0.  With the same D_k this means

    N_k + A e : e/2 - A e : eps(d),   E_k - A eps_0 : eps(u_k) + A eps_0 : eps_0/2,

and the distance of N_k to its lower bound, now ``A(eps(d) - e)^2/2``, is the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import ufl
from dolfinx import fem

from contact_locking.arrays import FloatArray, moments
from contact_locking.certificate.laws import law_limit
from contact_locking.certificate.solved_state import Criterion, SolvedState, reactions_by_part
from contact_locking.fem import compiled
from contact_locking.fem.compiled import assembled, integral
from contact_locking.problem import forms
from contact_locking.problem.rounding import ROUNDING
from contact_locking.results.derived import ContactFields

# The limit of a balance over the tolerance of the solver: residuals of free nodes may add up in the
# sum of all forces and moments.
_BALANCE_SHARE = 10.0


@dataclass(frozen=True)
class Equilibrium:
    """Resultants on the body, (d,) each, and relative errors of its balances.

    - ``residual``: ``|a(u, v) + (Z, eps(v)) + int p v_nu - int sigma_tau . v_tau - (f, v)|`` over
      the free dofs, over the larger of the norms of ``(f, v)`` and ``a(u, v)`` over all dofs
    - ``force``, ``moment``: of the sum of loads, contact forces and reactions, over the largest of
      the three sums of nodal magnitudes, times the extent of the body for the moment; of an
      axisymmetric body only the axial force is balanced, and ``moment`` is None
    - ``loads``, ``contact``, ``reactions``: the resultants
    - ``reactions_by_part``: by boundary part with prescribed displacements or springs
    - ``tools``: for each pushed foundation with direction m
      ``|F - k q - int (sigma_tau - p nu) . m|``, over F or the integral of the magnitudes

    Forces as small as the rounding in u or in the reactions count as zero.  The forces of a user's
    own energy are included.
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
            meaning = "imbalance of the forces on a tool"
            criteria["tool_balance"] = Criterion(max(self.tools), share, meaning)
        return criteria


class NodalForces(NamedTuple):
    """Loads, elastic forces, and forces of contact and of a user's own energy, at the local dofs.

    ``reacting`` are the reactions, which are zero at free dofs in equilibrium.
    """

    load: FloatArray
    elastic: FloatArray
    touching: FloatArray
    own_energy: FloatArray
    reacting: FloatArray


def nodal_forces(state: SolvedState) -> NodalForces:
    """The forces of the stored stress, pressure and traction, and the loads; collective.

    Contact forces are computed apart from the solver, so that a wrong sign in either place shows.
    Loads and elastic forces use the forms of the solver.
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
        of_energy = -assembled(forms.own_forces(u, v, data))
    for contact in state.contacts:
        tractions = contact.traction - contact.pressure[:, None] * contact.normal
        touching += contact.surface.nodal_forces(tractions)
    reacting = elastic + assembled(of_stress) - of_energy - load - touching
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
    # The forces of a user's energy need not be internal.
    for vector in (load, touching, reacting, of_energy):
        nodal = vector[:owned].reshape(-1, state.dim)
        total.append(state.comm.allreduce(nodal.sum(axis=0)))
        if vector is not of_energy:
            magnitude = max(magnitude, state.sum(np.linalg.norm(nodal, axis=1)))
        turning = moments(x - centre, nodal).sum(axis=0)
        moment = moment + state.comm.allreduce(turning)
    # At rest and in rigid motions all forces are rounding, and the balances must still hold.
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
    """The relative imbalance along the travel of each pushed foundation; collective.

    Forces below ``least`` are rounding.
    """
    of_contact = {id(fields.contact): fields for fields in state.contacts}
    shares = []
    tools = state.system.tools
    for tool, force in zip(tools, tools.unbalanced, strict=True):
        fields = of_contact[id(tool.contact)]
        resultant, magnitude = tool.resultant(fields.pressure, fields.traction)
        imbalance = abs(float(force) - resultant)
        size = max(abs(tool.force), magnitude, least)
        shares.append(imbalance / size if size > 0.0 else imbalance)
    return tuple(shares)


@dataclass(frozen=True)
class Touch:
    """One contact in equilibrium, at its k nodes.

    - ``weights``, ``gap``, ``pressure``, ``bound``: (k,); weights are zero at held nodes
    - ``displacement``, ``normal``, ``traction``: (k, d), with ``sigma_tau`` as the traction
    """

    weights: FloatArray
    displacement: FloatArray
    normal: FloatArray
    gap: FloatArray
    pressure: FloatArray
    traction: FloatArray
    bound: FloatArray

    @classmethod
    def of(cls, state: SolvedState, fields: ContactFields) -> Touch:
        """The contact of a solved state."""
        return cls(
            weights=state.weights(fields),
            displacement=fields.u_normal[:, None] * fields.normal + fields.u_tangent,
            normal=fields.normal,
            gap=fields.gap,
            pressure=fields.pressure,
            traction=fields.traction,
            bound=fields.bound,
        )

    @classmethod
    def at_rest(cls, state: SolvedState, fields: ContactFields) -> Touch:
        """The contact before the first step; a foundation that would overlap just touches."""
        none, gap, weights = 0.0 * fields.gap, np.maximum(fields.gap, 0.0), state.weights(fields)
        still = np.zeros_like(fields.normal)
        return cls(weights, still, fields.normal, gap, none, still, none)

    def room(self, displacement: FloatArray) -> FloatArray:
        """``h(v) = gap - v . nu`` (k,) of a displacement v (k, d)."""
        return np.asarray(self.gap - np.sum(displacement * self.normal, axis=1))


@dataclass(frozen=True)
class Moment:
    """A state at one time, for the energy balance with the next state.

    - ``displacement``, ``forces``: local values, and external forces at the owned dofs
    - ``contacts``: each contact with its pressure and friction
    - ``stored``, ``work``: the stored energy, and the work that errors are relative to
    - ``negligible``: the norm of forces below which they are rounding
    - ``eigenstrain``: the local values of eps_0
    - ``eigenstrain_energy``: ``-(A eps_0, eps(u)) + (A eps_0, eps_0)/2``
    - ``in_equilibrium``: False after a restart with other data; the next step then has no bounds
    """

    displacement: FloatArray
    forces: FloatArray
    contacts: tuple[Touch, ...]
    stored: float
    work: float
    negligible: float
    eigenstrain: FloatArray
    eigenstrain_energy: float
    in_equilibrium: bool = True

    @classmethod
    def of(cls, state: SolvedState, in_equilibrium: bool = True) -> Moment:
        """The moment of a state; collective."""
        return cls(
            displacement=state.problem.u.x.array.copy(),
            forces=_external_forces(state),
            contacts=tuple(Touch.of(state, fields) for fields in state.contacts),
            stored=_stored(state),
            work=state.work,
            negligible=state.system.rounding.in_forces() / state.settings.tolerance,
            eigenstrain=_eigenstrain(state).copy(),
            eigenstrain_energy=_eigenstrain_energy(state, state.problem.u),
            in_equilibrium=in_equilibrium,
        )

    @classmethod
    def at_rest(cls, state: SolvedState) -> Moment:
        """The body at rest before the first step, without forces; collective.

        A foundation that overlaps the body in the first state touches the body here.
        """
        u, data = state.problem.u, state.problem.data
        still_body = fem.Function(u.function_space)
        forces: FloatArray = np.zeros_like(state.system.load)
        stored = 0.0
        if data.own_energy is not None:
            v = ufl.TestFunction(u.function_space)
            forces = assembled(forms.own_forces(still_body, v, data))[: len(forces)]
            stored = integral(state.problem.domain, data.own_energy(still_body))
        contacts = tuple(Touch.at_rest(state, fields) for fields in state.contacts)
        nothing = np.zeros_like(_eigenstrain(state))
        return cls(still_body.x.array.copy(), forces, contacts, stored, 0.0, 0.0, nothing, 0.0)


@dataclass(frozen=True)
class EnergyBalance:
    """Work, stored energy, dissipation by friction and numerical dissipation of a step.

    ``defect`` is the distance of the numerical dissipation from its bounds, relative to the largest
    of the work of the states, of nodal forces and of rounding; None without bounds.
    """

    work: float
    stored: float
    dissipated: float
    numerical: float
    defect: float | None

    @classmethod
    def of_row(cls, row: Mapping[str, float]) -> EnergyBalance:
        """The balance from a row of history.csv."""
        defect = None if math.isnan(row["energy_defect"]) else row["energy_defect"]
        return cls(row["work"], row["stored"], row["dissipated"], row["numerical"], defect)

    def criteria(self, state: SolvedState) -> dict[str, Criterion]:
        """The energy balance as a criterion of the certificate, if it has bounds."""
        if self.defect is None:
            return {}
        meaning = "energy that a step creates or loses"
        return {"energy_balance": Criterion(self.defect, law_limit(state), meaning)}


def energy_balance(before: Moment, state: SolvedState) -> tuple[EnergyBalance, Moment]:
    """The balance of the step from ``before`` to a solved state, and its moment; collective."""
    after = Moment.of(state)
    step = fem.Function(state.problem.u.function_space)
    step.x.array[:] = after.displacement - before.displacement
    moved = step.x.array[: len(after.forces)]
    quadratic = state.system.forms.energy(step)
    dissipated = sum(_friction_work(state, fields) for fields in state.contacts)
    places = list(zip(state.contacts, before.contacts, after.contacts, strict=True))
    resisted = sum(
        state.sum(old.weights * old.bound * _slid(old, new, fields.drag))
        for fields, old, new in places
    )

    def work_of(moment: Moment, at: Moment) -> float:
        """The work of the forces of a moment, with the change of the opening at a displacement."""
        total = state.sum(moment.forces * moved)
        for (fields, old, new), acting, placed in zip(
            places, moment.contacts, at.contacts, strict=True
        ):
            place = fields.contact.state.place if fields.contact.pairs_anew else placed.displacement
            opened = new.room(place) - old.room(placed.displacement)
            total -= state.sum(acting.weights * acting.pressure * opened)
            if fields.contact.moves:
                total += state.sum(acting.weights * _dragged(acting, fields))
        return total

    work, earlier = work_of(after, before), work_of(before, after)
    change = after.stored - before.stored
    numerical = work - change - dissipated
    highest = work - earlier - quadratic + resisted - dissipated
    if any(fields.contact.pairs_anew for fields in state.contacts):
        highest = math.inf
    outside = max(quadratic - numerical, numerical - highest, 0.0)
    size = max(after.work, before.work, state.sum(np.abs(after.forces * moved)))
    # The forces of a body that moves almost without strain are rounding.
    negligible = max(before.negligible, after.negligible)
    size = max(size, negligible * float(np.sqrt(state.sum(moved**2))))
    for fields, _, acting in places:
        if fields.contact.moves:
            size = max(size, state.sum(np.abs(acting.weights * _dragged(acting, fields))))
    defect = outside / size if size > 0.0 else outside
    judged = defect if before.in_equilibrium else None
    values = _eigenstrain(state)
    values[:] -= before.eigenstrain
    numerical += _eigenstrain_energy(state, step)
    values[:] = after.eigenstrain
    stored = after.stored + after.eigenstrain_energy
    change = stored - before.stored - before.eigenstrain_energy
    work = numerical + change + dissipated
    return EnergyBalance(work, stored, dissipated, numerical, judged), after


def _dragged(acting: Touch, fields: ContactFields) -> FloatArray:
    """``sigma_tau . m`` (k,)."""
    return np.asarray(np.sum(acting.traction * fields.drag, axis=1))


def _slid(old: Touch, new: Touch, drag: FloatArray) -> FloatArray:
    """``|(d - m)_tau|`` (k,), tangential to the foundation before the step."""
    slid = new.displacement - old.displacement - drag
    along = np.sum(slid * old.normal, axis=1)
    return np.asarray(np.linalg.norm(slid - along[:, None] * old.normal, axis=1))


def _friction_work(state: SolvedState, fields: ContactFields) -> float:
    """``int -sigma_tau . (u_tau - u_{k-1,tau})``; collective."""
    return state.sum(state.weights(fields) * -np.sum(fields.traction * fields.increment, axis=1))


def _stored(state: SolvedState) -> float:
    """``E``, including a user's own energy; collective."""
    penalty, points = state.target.penalty, state.points
    total = state.energy
    if np.isfinite(penalty.n):
        for law in points.sets:
            excess = law.excess(law.measured(state.problem.u))
            total += penalty.n * state.sum(points.weights * excess**2)
    if penalty.epsilon > 0.0:
        for fields in state.contacts:
            entered = np.maximum(fields.u_normal - fields.gap, 0.0)
            total += state.sum(state.weights(fields) * entered**2) / (2.0 * penalty.epsilon)
    if state.problem.data.own_energy is not None:
        total += integral(state.problem.domain, state.problem.data.own_energy(state.problem.u))
    return total


def _external_forces(state: SolvedState) -> FloatArray:
    """Loads and reactions at the owned dofs; collective."""
    balanced = nodal_forces(state).reacting[: len(state.system.load)]
    return state.system.load + state.problem.constraints.held_part(balanced)


def _eigenstrain(state: SolvedState) -> FloatArray:
    """The local values of the eigenstrain, none without one."""
    eigenstrain = state.problem.data.eigenstrain
    return np.zeros(0) if eigenstrain is None else np.asarray(eigenstrain.values.x.array)


def _eigenstrain_energy(state: SolvedState, w: fem.Function) -> float:
    """``-(A eps_0, eps(w)) + (A eps_0, eps_0)/2`` with the present values; collective."""
    return state.system.forms.eigenstrain_work(w) + state.system.forms.eigenstrain_energy()
