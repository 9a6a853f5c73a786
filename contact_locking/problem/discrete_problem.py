"""The body with its loads and supports, and the discrete problem: everything but the solver."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import BoolArray, IndexArray
from contact_locking.contact.contact import Contact, named
from contact_locking.contact.nodal_contact import (
    BoundsInForce,
    ContactState,
    NodalContact,
    place_of,
)
from contact_locking.contact.surface import PRESCRIBED
from contact_locking.contact.travel import Travel
from contact_locking.errors import InputError, with_key
from contact_locking.fem import compiled
from contact_locking.fem.fields import Clock, Entities, features
from contact_locking.fem.spaces import Element
from contact_locking.findings import TEXTS, Finding
from contact_locking.laws.body import squared_norm
from contact_locking.laws.limits import Penalty, PenaltyParameters
from contact_locking.mesh.domain import Domain, require_surface
from contact_locking.parallel import on_every_rank
from contact_locking.problem import forms
from contact_locking.problem.elasticity import Material
from contact_locking.problem.forms import ProblemData
from contact_locking.problem.loads import ElasticSupport, LoadOnMesh, OwnSupport, Springs
from contact_locking.problem.points import LimitsOnMesh, Placed, Points
from contact_locking.problem.rigidity import Rigidity
from contact_locking.supports.conditions import Constraints
from contact_locking.supports.support import (
    HOLD_ALONG,
    BodyForce,
    Displacement,
    Load,
    Spring,
    Support,
)
from contact_locking.values.concept import Concept, dotted
from contact_locking.values.kinds import expressions

_ADVICE = "refine the mesh there, or let a boundary of material.regions go there"
_ADVICE_ON_CELLS = "refine the mesh there, or let a boundary of the region in its on go there"
_ADVICE_ON_FACETS = "refine the mesh there"
# Loads over the stiffness of the material above which the units cannot be meant.
_ABSURD = 1e30
# A typical slip over the size of the body.
_SOME_SLIP = 1e-3


@dataclass(frozen=True)
class Body:
    """The body with its loads and supports, without contact; each concept has its key.

    - ``space``: the displacements, of the ``element``
    - ``elasticity``: A by cells, the last one counts; or the A of the bilinear ``form``
    - ``eigenstrains``, ``limits``: by cells; eigenstrains add up
    - ``regions``: sets of cells across whose boundary the stress may jump
    - ``held``, ``bcs``: prescribed displacements, as concepts and as conditions of DOLFINx
    - ``loads``, ``work``: as concepts and as a linear form
    - ``others``: the terms of ``form`` that are not the work of a stress
    - ``own_energy``: maps u to a convex and differentiable functional
    """

    domain: Domain
    element: Element
    space: fem.FunctionSpace
    elasticity: Sequence[Placed]
    eigenstrains: Sequence[Placed] = ()
    limits: Sequence[Placed] = ()
    regions: Sequence[IndexArray] = ()
    held: Sequence[Support | Displacement] = ()
    bcs: Sequence[fem.DirichletBC] = ()
    loads: Sequence[Load] = ()
    springs: Sequence[Spring] = ()
    work: ufl.Form | None = None
    form: ufl.Form | None = None
    others: ufl.Form | None = None
    own_energy: Callable[[fem.Function], Expr] | None = None

    def elastic(self, material: Material) -> Callable[[Expr, Expr], ufl.Form]:
        """``a(u, v)`` as a function of u and v."""
        element, form = self.element, self.form
        dx = element.elastic_dx(self.domain.dx())

        def of_stress(u: Expr, w: Expr) -> ufl.Form:
            return ufl.inner(material.linear(element.strain(u)), element.strain(w)) * dx

        def of_form(u: Expr, w: Expr) -> ufl.Form:
            assert form is not None
            test, trial = form.arguments()
            return ufl.replace(form, {trial: u, test: w})

        return of_stress if form is None else of_form

    def require_parts(self, contacts: Sequence[Contact]) -> None:
        """Raise InputError for boundary parts that the mesh does not have; collective."""
        domain = self.domain
        loads = [load for load in self.loads if not isinstance(load, BodyForce)]
        for concept in (*contacts, *loads, *self.springs):
            domain.facets(concept.on, f"{concept.key}.on")
            require_surface(domain, concept.on, f"{concept.key}.on")
        for concept in contacts:
            numbers = np.unique(domain.parts[domain.owners(domain.facets(concept.on))])
            bodies = set[int]().union(*domain.comm.allgather(numbers.tolist()))
            if concept.against and set(concept.on) == set(concept.against) and len(bodies) < 2:
                first, names = concept.on[0], ", ".join(concept.on)
                raise InputError(
                    f"{names} belongs to one body; where it holds both lips of a cut, give each "
                    f"lip a name in mesh.parts, as {first}_1: {{on: [{names}], facing: [0, 1]}}, "
                    "where the body has this outward normal, for on and for against",
                    f"{concept.key}.against",
                )

    def require_free(self, contacts: Sequence[Contact]) -> None:
        """Raise InputError for a condition that prescribes the normal displacement of Gamma_C.

        Conditions of DOLFINx may do so; contact does not act at their nodes.  Collective.
        """
        domain = self.domain
        facets = [
            np.empty(0, dtype=np.int32),
            *(domain.facets(contact.on, f"{contact.key}.on") for contact in contacts),
        ]
        on_contact = np.concatenate(facets)
        for condition in self.held:
            both = np.intersect1d(domain.facets(condition.on, f"{condition.key}.on"), on_contact)
            normals, areas = domain.area_normals(both)
            values = condition.value if isinstance(condition, Displacement) else [condition.value]
            across = np.abs(normals) * [value is not None for value in values]
            if domain.comm.allreduce(np.sum(across > PRESCRIBED * areas[:, None])):
                raise InputError(
                    "Gamma_C and Gamma_D overlap: contact and a displacement across it share "
                    f"facets of {', '.join(map(repr, condition.on))}; {HOLD_ALONG}",
                    f"{condition.key}.on",
                )


class DiscreteProblem:
    """The discrete problem; values of its data may change between solves.

    - ``data``, ``contacts``: what the forms need, and its contacts
    - ``u``: the displacement
    - ``penalty``: the penalty parameters to solve for
    - ``follows_n``: whether the compliance of contact is 1/n by default
    - ``rigidity``, ``held``: the rigid motions, and how each boundary part is held
    - ``clock``: the time of data that depend on it
    - ``free``, ``sliding``: the numbers of rigid motions that contact or friction alone stops
    - ``sprung``: that of rigid motions that springs stop and displacement conditions do not

    The constructor is collective and raises InputError for unusable data.
    """

    def __init__(
        self,
        body: Body,
        contacts: Sequence[Contact],
        penalty: PenaltyParameters,
        clock: Clock,
    ) -> None:
        domain, element, space = body.domain, body.element, body.space
        body.require_parts(contacts)
        self.clock = clock
        self.body, self.domain, self.element = body, domain, element
        self.constraints = Constraints(domain, space, body.held, body.bcs, clock)
        self.regions = tuple(body.regions)
        self.loads = [LoadOnMesh(domain, element, load, clock) for load in body.loads]
        for load in self.loads:
            load.advance()
        springs: list[ElasticSupport] = [*Springs.of(domain, body.springs, clock)]
        if body.others is not None:
            springs.append(OwnSupport(body.others))
        points = Points(domain, element, clock)
        self.material = Material(points, body.elasticity, body.eigenstrains)
        self.limits = LimitsOnMesh.of(points, body.limits)
        n, epsilon = penalty.n, penalty.compliance
        self.follows_n = penalty.epsilon is None
        # The paper uses the compliance epsilon also for the regularisation length in (22): here
        # Young's modulus converts the compliance to a length.
        slip = self.material.young * epsilon
        contacts = named(contacts)
        places = [place_of(contact, domain, space, element) for contact in contacts]
        nodal = tuple(
            NodalContact(contact, place, self.constraints, slip, clock)
            for contact, place in zip(contacts, places, strict=True)
        )
        self.contacts = nodal
        slips = tuple(contact.regularisation for contact in nodal)
        self.penalty = Penalty(n, epsilon, slips)
        self.data = forms.ProblemData(
            elasticity=body.elastic(self.material),
            elastic_stress=self.material.stress,
            largest_eigenvalue=self.material.largest_eigenvalue,
            inverse_limit=self.limits.ball.strain_set.inverse_limit,
            dx=domain.dx(),
            loads=self._work(),
            contacts=nodal,
            bounds=BoundsInForce(nodal),
            element=element,
            limits=tuple(limited.strain_set for limited in self.limits.others),
            tools=tuple(Travel(contact) for contact in nodal if contact.is_free),
            own_energy=body.own_energy,
            eigenstrain=self.material.eigenstrain,
            springs=tuple(springs),
        )
        self.u = fem.Function(space, name="displacement")
        self.rigidity = Rigidity(domain, space, self.data, self.constraints)
        self.held = self.rigidity.held(body.held)
        counts = [(held.free, held.sliding, held.sprung) for held in self.held]
        self.free, self.sliding, self.sprung = map(sum, zip(*counts, strict=True))
        self._findings = findings(self)

    @property
    def findings(self) -> list[Finding]:
        """The findings about the data, with those about loads at later times."""
        return list(dict.fromkeys([*self._findings, *_loads(self)]))

    def require_times(self, times: Sequence[float]) -> None:
        """Raise InputError for a table over the time that ends before a process does."""
        body, place = self.body, self.domain.bounding_box.mean(axis=0)[:, None]
        placed = [Placed(each, each.key) for each in (*body.held, *body.loads, *body.springs)]
        placed += [Placed(each.concept, each.key) for each in self.contacts]
        for data in (*body.elasticity, *body.limits, *body.eigenstrains, *placed):
            inside = expressions(data.content) if isinstance(data.content, Concept) else ()
            for inner, value, _ in inside:
                with_key(data.key_of(*inner), partial(value.require_times, place, times))

    def set_memory(self, states: Sequence[ContactState]) -> None:
        """Begin a step with what friction remembers at each contact; collective."""
        for contact, state in zip(self.contacts, states, strict=True):
            contact.set_memory(state)

    def at_rest(self) -> tuple[ContactState, ...]:
        """What friction remembers before the first step: nothing has moved."""
        return tuple(
            ContactState.at_rest(len(contact.surface.nodes), self.domain.dim)
            for contact in self.contacts
        )

    def update_foundations(self) -> None:
        """Update prescribed displacements, foundations and their forces to the time; collective.

        Raises InputError for a value that is not finite, and for a force that changes direction.
        """
        self.constraints.advance()
        for contact in self.contacts:
            contact.update_foundation()
        for tool in self.data.tools:
            tool.advance()

    def update_pairs(self, touching: Sequence[BoolArray], settled: Sequence[bool]) -> bool:
        """Pair the bodies anew where they are at the solution u; collective.

        ``touching`` are the nodes (k,) that touch at each contact; ``settled`` says whether its
        forces are those of the previous pairing.  Returns whether a pairing has changed, in which
        case u is the solution for the previous one.
        """
        every = zip(self.contacts, touching, settled, strict=True)
        return any([contact.update_pairs(self.u, at, same) for contact, at, same in every])

    def refresh(self) -> None:
        """Update everything to the present values of the data; collective."""
        self.material.refresh()
        self.limits.refresh()
        for load in self.loads:
            if load.is_timed:
                load.advance()
        self.update_foundations()

    def _work(self) -> ufl.Form | None:
        """The loads, minus the work of the stress that an eigenstrain causes at zero strain."""
        body, material = self.body, self.material
        v = ufl.TestFunction(body.space)
        parts = [ufl.inner(load.density, v) * load.measure for load in self.loads]
        if body.work is not None:
            parts.append(ufl.replace(body.work, {body.work.arguments()[0]: v}))
        if material.eigenstrain is not None:
            density = ufl.inner(material.eigenstrain.stress, body.element.strain(v))
            parts.append(-density * body.element.elastic_dx(body.domain.dx()))
        return sum(parts) if parts else None

    def close(self) -> None:
        """Destroy the PETSc objects; collective."""
        for contact in self.contacts:
            contact.friction.smoothing.destroy()
            contact.surface.close()


def findings(problem: DiscreteProblem) -> list[Finding]:
    """Properties of the data that the user probably did not intend; collective.

    Raises InputError for loads with units that cannot be meant.
    """
    return [finding for check in _CHECKS for finding in check(problem)]


def _mesh(problem: DiscreteProblem) -> Iterator[Finding]:
    """What the mesh was read with."""
    domain = problem.domain
    yield from (finding.at(domain.origin) for finding in domain.findings)


def _contacts(problem: DiscreteProblem) -> Iterator[Finding]:
    """Foundations, gaps, pairs and R that do not fit the body or its mesh."""
    for contact in problem.contacts:
        yield from contact.findings()


def _loads(problem: DiscreteProblem) -> Iterator[Finding]:
    """Loads that vanish, or change too sharply for the mesh, at a time so far."""
    for load in problem.loads:
        yield from load.findings


def _large_loads(problem: DiscreteProblem) -> Iterator[Finding]:
    """Loads that exceed the stiffness of the material."""
    for load in problem.loads:
        ratio = load.stress / problem.material.stiffness
        if ratio > _ABSURD:
            raise InputError(TEXTS["load.large"].format(ratio=ratio), load.key)
        if ratio > 1.0:
            yield Finding("load.large", load.key, ratio=ratio)


def _features_in_cells(problem: DiscreteProblem) -> Iterator[Finding]:
    """Data of the material that change between the points of the strains."""
    body, domain, times = problem.body, problem.domain, problem.clock.some_times
    every = np.arange(len(domain.parts), dtype=np.int32)
    for items, advice, relative in (
        ((*body.elasticity, *body.limits), _ADVICE, "each"),
        (body.eigenstrains, _ADVICE_ON_CELLS, "all"),
    ):
        for data in items:
            cells = every if data.cells is None else data.cells
            inside = expressions(data.content) if isinstance(data.content, Concept) else ()
            for place, value, _ in inside:
                entities = Entities.of(domain, domain.dim, cells)
                yield from features(entities, value, data.key_of(*place), advice, relative, times)


def _features_on_facets(problem: DiscreteProblem) -> Iterator[Finding]:
    """Prescribed displacements, springs and friction that change between the nodes."""
    body, domain = problem.body, problem.domain

    def facets(on: Sequence[str]) -> Entities:
        return Entities.of(domain, domain.dim - 1, domain.facets(on))

    for held in (*body.held, *body.springs):
        for place, value, _ in expressions(held):
            key, times = dotted(held.key, *place), problem.clock.some_times
            yield from features(facets(held.on), value, key, _ADVICE_ON_FACETS, times=times)
    for contact in problem.contacts:
        friction = contact.concept.friction
        mu = None if friction is None else friction.coefficient
        if mu is None or mu.expression is None:
            continue
        key, rubbing = contact.concept.friction_key("coefficient"), facets(contact.on)
        # mu may change near s = 0; a slip as long as the body stands for an infinite one.
        slips = [0.0, _SOME_SLIP * domain.extent, domain.extent]
        for slip in slips if "s" in mu.expression.names else slips[:1]:
            if sharp := features(rubbing, mu, key, _ADVICE_ON_FACETS, s=slip):
                yield from sharp
                break


_CHECKS = (_mesh, _contacts, _loads, _large_loads, _features_in_cells, _features_on_facets)


def distance(u: fem.Function, other: fem.Function, data: ProblemData) -> dict[str, float]:
    """``sqrt(a(u - w, u - w))`` and ``|eps(u - w)|`` of the displacements u and w, ``other``.

    The keys are ``energy_norm`` and ``displacement_norm``; ``relative`` is the first over
    ``sqrt(a(u, u))``.  Collective; raises InputError for another mesh, distribution or degree.
    """
    mesh = u.function_space.mesh
    comm = mesh.comm
    points, other_points = mesh.geometry.x, other.function_space.mesh.geometry.x
    is_alike = np.array_equal(points, other_points) and len(u.x.array) == len(other.x.array)
    if not on_every_rank(comm, is_alike):
        raise InputError("must be a solution on the same mesh, of the same degree", "other")
    difference = fem.Function(u.function_space)
    difference.x.array[:] = u.x.array - other.x.array

    def total(form: Any) -> float:
        return float(np.sqrt(comm.allreduce(fem.assemble_scalar(compiled.form(form)))))

    energy = total(forms.elastic_form(difference, difference, data))
    size = total(forms.elastic_form(u, u, data))
    return {
        "energy_norm": energy,
        "relative": energy / size if size > 0.0 else energy,
        "displacement_norm": total(
            squared_norm(data.strain(difference)) * data.element.elastic_dx(data.dx)
        ),
    }
