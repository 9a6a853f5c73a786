"""The discrete problem before a solve: all that it is made of, on the mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.contact import Contact, named
from contact_locking.contact.foundation import GivenGap
from contact_locking.contact.nodal_contact import (
    BoundsInForce,
    ContactState,
    NodalContact,
    place_of,
)
from contact_locking.contact.travel import Travel
from contact_locking.errors import InputError
from contact_locking.fem import compiled
from contact_locking.fields.findings import about_an_overlap_at_rest
from contact_locking.fields.present import Clock
from contact_locking.laws.locking import squared_norm
from contact_locking.laws.penalty import Penalty, PenaltyParameters
from contact_locking.parallel import on_every_rank
from contact_locking.problem import forms
from contact_locking.problem.body import Body
from contact_locking.problem.elasticity import Material
from contact_locking.problem.forms import ProblemData
from contact_locking.problem.loads import Loads
from contact_locking.problem.points import LimitsOnMesh, Points
from contact_locking.problem.rigidity import Held, Rigidity
from contact_locking.problem.springs import ElasticSupport, OwnSupport, Springs
from contact_locking.supports.conditions import Constraints
from contact_locking.supports.support import Displacement, Support


class DiscreteProblem:
    """The discrete problem: its parts stay, and the values of its data may change.

    ``data`` holds the forms' data, ``u`` the displacement, ``penalty`` the penalty parameters to
    solve for, ``rigidity`` knows the rigid motions, and ``held`` tells how each part is held.
    ``clock`` has the time of data that depend on it.
    ``follows_n`` says that the compliance of the contact was not chosen, but is 1/n.  ``warnings``
    tell what is probably not intended.

    The constructor is collective.  Raises InputError for data that cannot be used, and for a
    foundation behind Gamma_C.
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
        self.loads = Loads(domain, element, body.loads, clock)
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
        places = [place_of(item, domain, space, element) for item in contacts]
        nodal = tuple(
            NodalContact(item, place, self.constraints, slip, clock)
            for item, place in zip(contacts, places, strict=True)
        )
        self.warnings = [
            text for contact in nodal for text in (*contact.warnings(), *_overlap_warnings(contact))
        ]
        slips = tuple(contact.regularisation for contact in nodal)
        self.penalty = Penalty(n, epsilon, slips)
        self.data = forms.ProblemData(
            elasticity=_elastic(body, self.material),
            elastic_stress=self.material.stress,
            largest_eigenvalue=self.material.largest_eigenvalue,
            inverse_limit=self.limits.ball.strain_set.inverse_limit,
            dx=domain.dx(),
            loads=self._work(),
            contacts=nodal,
            bounds=BoundsInForce(nodal),
            n=fem.Constant(domain.mesh, n),
            epsilon=fem.Constant(domain.mesh, epsilon),
            element=element,
            limits=tuple(item.strain_set for item in self.limits.others),
            tools=tuple(Travel(item) for item in nodal if item.is_free),
            own_energy=body.own_energy,
            eigenstrain=self.material.eigenstrain,
            springs=tuple(springs),
        )
        self.u = fem.Function(space, name="displacement")
        self.rigidity = Rigidity(domain, space, self.data, self.constraints)
        self.held: list[Held] = self.rigidity.held(
            *(
                [name for item in body.held if isinstance(item, kind) for name in item.on]
                for kind in (Displacement, Support)
            )
        )
        self.warnings += self.loads.warnings(self.material.stiffness)
        self.warnings += body.features(contacts, clock)

    @property
    def contacts(self) -> tuple[NodalContact, ...]:
        return self.data.contacts

    @property
    def free(self) -> int:
        """The number of rigid motions that contact alone stops."""
        return sum(part.free for part in self.held)

    @property
    def sliding(self) -> int:
        """The number of rigid motions that friction alone stops."""
        return sum(part.sliding for part in self.held)

    @property
    def sprung(self) -> int:
        """The number of rigid motions that springs stop and no displacement condition does."""
        return sum(part.sprung for part in self.held)

    def enter(self, states: Sequence[ContactState]) -> None:
        """Begin a step with the memory of friction at each contact; collective."""
        for contact, state in zip(self.contacts, states, strict=True):
            contact.enter(state)

    def at_rest(self) -> tuple[ContactState, ...]:
        """The memory of friction before the first step."""
        return tuple(
            ContactState.at_rest(len(item.surface.nodes), self.domain.dim) for item in self.contacts
        )

    def place(self) -> None:
        """Take the present prescribed displacements, foundations and forces; collective.

        Raises InputError for a value that is not finite, and for a force that turns.
        """
        self.constraints.advance()
        for contact in self.contacts:
            contact.place()
        for tool in self.data.tools:
            tool.advance()

    def go_along(self, touching: Sequence[BoolArray]) -> bool:
        """Let bodies face each other as they do at the solution u; collective.

        ``touching`` are the nodes (k,) that touch at each contact.  Returns whether a frame has
        changed, so that u is the solution in the frame before.
        """
        pairs = zip(self.contacts, touching, strict=True)
        return any([contact.go_along(self.u, touches) for contact, touches in pairs])

    def refresh(self) -> None:
        """Take the present values of all data; collective.

        Raises InputError as at first, but for parts that are free to move.
        """
        self.material.refresh()
        self.limits.refresh()
        self.warnings += self.loads.advance()
        self.place()

    def _work(self) -> ufl.Form | None:
        """The loads, less the work of the stress of the body without strain."""
        body, material = self.body, self.material
        v = ufl.TestFunction(body.space)
        parts = [self.loads.work(v)]
        if body.work is not None:
            parts.append(ufl.replace(body.work, {body.work.arguments()[0]: v}))
        if material.eigenstrain is not None:
            density = ufl.inner(material.eigenstrain.stress, body.element.strain(v))
            parts.append(-density * body.element.elastic_dx(body.domain.dx()))
        forms = [form for form in parts if form is not None]
        return sum(forms) if forms else None

    def close(self) -> None:
        """Destroy the PETSc objects; collective."""
        for contact in self.contacts:
            contact.friction.smoothing.destroy()
            contact.surface.close()


def _overlap_warnings(contact: NodalContact) -> list[str]:
    """The warning about a foundation with friction that overlaps the body at rest; collective."""
    friction, surface = contact.friction, contact.surface
    if contact.moves or surface.is_paired or isinstance(contact.foundation, GivenGap):
        return []
    mu: FloatArray = np.ones(len(surface.nodes))
    if friction.is_coulomb:
        mu = friction.coefficient(np.zeros_like(mu))
    depths = np.where(contact.free, -contact.gaps, 0.0)
    return about_an_overlap_at_rest(
        surface.domain,
        depths,
        contact.normals,
        surface.body_normals(),
        mu,
        f"{contact.key}.foundation",
    )


def _elastic(body: Body, material: Material) -> Callable[[Expr, Expr], ufl.Form]:
    """``a(u, v)`` for any displacements."""
    if body.form is None:
        element = body.element
        dx = element.elastic_dx(body.domain.dx())

        def of_stress(u: Expr, w: Expr) -> ufl.Form:
            return ufl.inner(material.linear(element.strain(u)), element.strain(w)) * dx

        return of_stress
    test, trial = body.form.arguments()
    form = body.form

    def of_form(u: Expr, w: Expr) -> ufl.Form:
        return ufl.replace(form, {trial: u, test: w})

    return of_form


def distance(u: fem.Function, other: fem.Function, data: ProblemData) -> dict[str, float]:
    """``sqrt(a(u - w, u - w))`` and ``|eps(u - w)|`` of displacements u and w; collective.

    They are ``energy_norm`` and ``displacement_norm``, and ``relative`` is the first over
    ``sqrt(a(u, u))``.  Raises InputError for displacements of other meshes, distributions or
    degrees.
    """
    mesh = u.function_space.mesh
    comm = mesh.comm
    here, there = mesh.geometry.x, other.function_space.mesh.geometry.x
    is_alike = np.array_equal(here, there) and len(u.x.array) == len(other.x.array)
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
