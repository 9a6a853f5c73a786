"""The quantities that have a derivative, with their gradients.

============================ ==================================================================
compliance                 ``(f, u)``
elastic_energy             ``a(u, u)/2``, that of ``eps(u) - eps_0`` with an eigenstrain
contact_force.i            ``-int p nu_i``, or contacts.NAME.contact_force.i of one contact
friction_force.i           ``int sigma_tau_i``, or contacts.NAME.friction_force.i of one contact
reactions.PART.i           the resultant of the reactions and springs of a boundary part
pressure_max               the pressure at the node where it is largest, and stays so
contacts.NAME.tool.travel     the way of a tool that a force pushes
============================ ==================================================================

The forces without a name are those of the summary: of several contacts, the sums over those with
foundations.  NAME is the name of a contact, or its number from 0.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np
import ufl

from contact_locking.arrays import FloatArray
from contact_locking.certificate.solved_state import shares_by_part
from contact_locking.errors import InputError
from contact_locking.inverse.equations import Equations, Residual
from contact_locking.inverse.linearisation import Gradient
from contact_locking.mesh.domain import Domain
from contact_locking.plain_text import nearest
from contact_locking.problem import forms
from contact_locking.problem.loads import ElasticSupport
from contact_locking.problem.system import System
from contact_locking.results.quantities import QUANTITIES
from contact_locking.solver.interior_point.contact_cones import ContactCones, FrictionCones
from contact_locking.solver.interior_point.family import Family


@dataclass(frozen=True)
class Quantity(ABC):
    """A number of an iterate, with its derivatives; methods are collective.

    The value at other data has what the data themselves do to it; the gradient is by displacement,
    travels and reactions.
    """

    name: str

    @abstractmethod
    def value(self, equations: Equations, residual: Residual) -> float:
        """The value for the present data, where the equations leave ``residual``."""

    @abstractmethod
    def gradient(self, equations: Equations) -> Gradient:
        """The derivatives at the iterate."""

    def functional(self, equations: Equations) -> ufl.Form:
        """The share of the value that forms of the body have, at the present displacement."""
        return ufl.Form([])

    def at(self, equations: Equations) -> Quantity:
        """The quantity with the place that it keeps, if it has one."""
        return self


def scale_of(name: str, domain: Domain, system: System) -> float:
    """The size of a quantity of this unit, by the energy and the displacement; collective."""
    length, energy = system.largest_displacement(), abs(system.elastic_energy())
    force = energy / length if length > 0.0 else 0.0
    key = next((word for word in reversed(name.split(".")) if word in QUANTITIES), "")
    of_tool = "length" if name.endswith(".travel") else "force"
    unit, face = QUANTITIES[key].unit if key else of_tool, domain.extent ** (domain.dim - 1)
    return {"energy": energy, "force": force, "stress": force / face, "length": length}[unit]


def quantity_of(name: str, domain: Domain, system: System) -> Quantity:
    """The quantity with a name; collective.  Raises InputError for one without a derivative."""
    parts, dim = name.split("."), domain.dim
    registered = QUANTITIES.get(parts[-1])
    if registered is not None and registered.trend == "jumps":
        raise InputError(
            f"{name} is a count of points, which jumps: it has no derivative", "sensitivities.of"
        )
    if name in ("compliance", "elastic_energy"):
        return _Energy(name)
    if name == "pressure_max" and system.contacts:
        return _LargestPressure(name)
    if match := re.fullmatch(r"(?:contacts\.([^.]+)\.)?(contact|friction)_force\.(\d)", name):
        kind, axis = match[2], int(match[3])
        chosen = _contacts_named(match[1], system)
        if axis < dim and chosen:
            cones = ContactCones if kind == "contact" else FrictionCones
            return _Resultant(name, chosen, cones, axis)
    if match := re.fullmatch(r"contacts\.([^.]+)\.tool\.travel", name):
        for number, tool in enumerate(system.tools):
            index = system.contacts.index(tool.contact)
            if index in _contacts_named(match[1], system):
                return _Travel(name, number)
    if match := re.fullmatch(r"reactions\.(.+)\.(\d)", name):
        reaction = _Reaction(name, match[1], int(match[2]), domain)
        if reaction.axis < dim and (reaction.lifts(system) is not None or reaction.springs(system)):
            return reaction
    derived = [entry for entry in QUANTITIES.values() if entry.derives]
    forces = [f"{entry.key}.0" for entry in derived if entry.unit == "force"]
    scalars = [entry.key for entry in derived if entry.unit != "force"]
    each = [f"contacts.NAME.{force}" for force in forces]
    known = [*scalars, *forces, *each, "contacts.NAME.tool.travel", "reactions.PART.0"]
    raise InputError(
        f"no quantity '{name}' has a derivative{nearest(name, known)}; there are "
        f"{', '.join(known)}",
        "sensitivities.of",
    )


def _contacts_named(name: str | None, system: System) -> tuple[int, ...]:
    """The numbers of the contacts of a resultant: of a name, or None for that of the summary."""
    numbers = range(len(system.contacts))
    if name is None:
        of_foundations = [number for number in numbers if not system.contacts[number].against]
        return tuple(of_foundations) if len(numbers) > 1 else tuple(numbers)
    named = [number for number in numbers if system.contacts[number].concept.name == name]
    return tuple(named or [number for number in numbers if str(number) == name])


def _nothing(equations: Equations) -> FloatArray:
    return np.zeros_like(equations.displacement)


def _sum(equations: Equations, local: float) -> float:
    return float(equations.system.comm.allreduce(local))


class _Energy(Quantity):
    """The compliance or the elastic energy, with the work of the forces of an eigenstrain."""

    @property
    def is_stored(self) -> bool:
        return self.name == "elastic_energy"

    def value(self, equations: Equations, residual: Residual) -> float:
        system = equations.system
        return system.elastic_energy() if self.is_stored else system.compliance()

    def gradient(self, equations: Equations) -> Gradient:
        gradient, system = _nothing(equations), equations.system
        count = len(system.load)
        forces = system.forms.elastic_forces(system.u)[:count] if self.is_stored else system.load
        gradient[:count] = forces + system.forms.eigenstrain_forces()[:count]
        return Gradient(gradient, {})

    def functional(self, equations: Equations) -> ufl.Form:
        data, u = equations.system.data, equations.system.u
        stored = 0.5 * forms.elastic_form(u, u, data)
        energy = stored if self.is_stored else forms.external_work(u, data)
        if data.eigenstrain is None:
            return energy
        energy += forms.initial_work(u, data)
        return energy + forms.initial_energy(data) if self.is_stored else energy


@dataclass(frozen=True)
class _Resultant(Quantity):
    """``-int p nu_i`` or ``int sigma_tau_i`` over some contacts."""

    contacts: tuple[int, ...]
    cones: type[ContactCones] | type[FrictionCones]
    axis: int

    def _directions(self, equations: Equations) -> dict[Family, FloatArray]:
        directions: dict[Family, FloatArray] = {}
        for family in equations.families:
            if not isinstance(family, ContactCones | FrictionCones):
                continue
            if isinstance(family, self.cones) and family.nodes.number in self.contacts:
                normal = family.nodes.normal
                directions[family] = -normal[self.axis]
                if isinstance(family, FrictionCones):
                    unit = np.eye(len(normal))[self.axis]
                    directions[family] = normal[self.axis] * normal - unit[:, None]
        return directions

    def value(self, equations: Equations, residual: Residual) -> float:
        directions = self._directions(equations)
        local = sum(family.power(family.reactions, d) for family, d in directions.items())
        return _sum(equations, float(local))

    def gradient(self, equations: Equations) -> Gradient:
        return Gradient(_nothing(equations), self._directions(equations))


@dataclass(frozen=True)
class _LargestPressure(Quantity):
    """The pressure at one node: ``place`` is its rank, the number of its family, and its number."""

    place: tuple[int, int, int] | None = None

    def at(self, equations: Equations) -> Quantity:
        comm, best = equations.system.comm, (0.0, 0, -1, -1)
        for number, family in enumerate(equations.families):
            if isinstance(family, ContactCones) and len(family.z):
                node = int(np.argmax(family.z))
                best = max(best, (float(family.z[node]), -comm.rank, number, node))
        _, rank, number, node = max(comm.allgather(best))
        return replace(self, place=(-rank, number, node) if number >= 0 else None)

    def value(self, equations: Equations, residual: Residual) -> float:
        largest = 0.0
        if self.place is not None and self.place[0] == equations.system.comm.rank:
            largest = float(equations.families[self.place[1]].z[self.place[2]])
        return _sum(equations, largest)

    def gradient(self, equations: Equations) -> Gradient:
        if self.place is None:
            return Gradient(_nothing(equations), {})
        rank, number, node = self.place
        family = equations.families[number]
        unit = np.zeros_like(family.z)
        if rank == equations.system.comm.rank:
            unit[node] = 1.0 / family.weights[node]
        return Gradient(_nothing(equations), {family: unit})


@dataclass(frozen=True)
class _Travel(Quantity):
    """The travel of the tool with a number."""

    number: int

    def value(self, equations: Equations, residual: Residual) -> float:
        return equations.system.tools.travels[self.number]

    def gradient(self, equations: Equations) -> Gradient:
        gradient = _nothing(equations)
        gradient[len(equations.system.load) + self.number] = 1.0
        return Gradient(gradient, {})


@dataclass(frozen=True)
class _Reaction(Quantity):
    """The work of all forces with a displacement of held dofs, and of springs with a unit one."""

    part: str
    axis: int
    domain: Domain

    def value(self, equations: Equations, residual: Residual) -> float:
        system, count = equations.system, len(equations.system.load)
        pulled = sum(spring.forces(system.u)[:count] for spring in self.springs(system))
        local = float(np.sum(pulled * self._unit(system)))
        if (lifts := self.lifts(system)) is not None:
            local += float(lifts @ residual.forces[:count])
        return _sum(equations, local)

    def gradient(self, equations: Equations) -> Gradient:
        system, count = equations.system, len(equations.system.load)
        gradient, seen = _nothing(equations), dict[Family, FloatArray]()
        unit = system.function_of(self._unit(system))
        for spring in self.springs(system):
            gradient[:count] += spring.forces(unit)[:count]
        if (lifts := self.lifts(system)) is not None:
            lifted = system.function_of(lifts)
            gradient[:count] += system.forms.elastic_forces(lifted)[:count]
            at_rest = _nothing(equations)
            at_rest[:count] = lifts
            seen = {family: family.see(at_rest) for family in equations.families}
        return Gradient(gradient, seen)

    def functional(self, equations: Equations) -> ufl.Form:
        system, data, power = equations.system, equations.system.data, ufl.Form([])
        unit = system.function_of(self._unit(system))
        for spring in self.springs(system):
            power -= spring.form(system.u, unit)
        if (lifts := self.lifts(system)) is not None:
            lifted = system.function_of(lifts)
            power += forms.elastic_form(system.u, lifted, data) - forms.external_work(lifted, data)
        return power

    def springs(self, system: System) -> list[ElasticSupport]:
        return [spring for spring in system.data.springs if spring.on == self.part]

    def lifts(self, system: System) -> FloatArray | None:
        """The owned displacement whose work with reactions is the resultant; collective.

        It follows the directions of supports; None for a part that holds nothing.
        """
        dim, count = system.dim, len(system.load)
        lift = np.zeros((count // dim, dim))
        for direction in range(dim):
            unit = np.tile(np.eye(dim)[direction], count // dim)
            shares = shares_by_part(self.domain, system.constraints, unit)
            if self.part not in shares:
                return None
            lift[:, direction] = shares[self.part].reshape(-1, dim)[:, self.axis]
        return lift.reshape(-1)

    def _unit(self, system: System) -> FloatArray:
        """The owned unit displacement along the axis."""
        return np.tile(np.eye(system.dim)[self.axis], len(system.load) // system.dim)
