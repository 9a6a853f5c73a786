"""The body with its loads and supports, before it is discretised."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import IndexArray
from contact_locking.contact.contact import Contact
from contact_locking.contact.surface import PRESCRIBED
from contact_locking.errors import InputError
from contact_locking.fem.spaces import Element
from contact_locking.fields.present import Clock
from contact_locking.fields.sampling import Entities, features
from contact_locking.mesh.domain import Domain, require_surface
from contact_locking.problem.points import Placed
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
# A slip, as a share of the size of the body.
_SOME_SLIP = 1e-3


@dataclass(frozen=True)
class Body:
    """The body with its loads and supports, without contact; each concept has its key.

    ``space`` is the space of displacements of ``element``.  ``elasticity`` is A in cells, of which
    the last counts, or the A in the bilinear ``form`` if one is given, whose ``others`` are the
    terms that are no work of stresses; ``eigenstrains`` in cells add up.  ``regions`` are cells
    whose stress may jump against that of all others.  ``held`` are the prescribed displacements,
    beside those of conditions of DOLFINx, ``bcs``.  ``work`` is a linear form beside the ``loads``,
    and ``own_energy`` maps u to a convex and differentiable functional.
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

    def require_parts(self, contacts: Sequence[Contact]) -> None:
        """Raise InputError for parts that do not fit the mesh; collective."""
        domain = self.domain
        loads = [item for item in self.loads if not isinstance(item, BodyForce)]
        for part in (*contacts, *loads, *self.springs):
            domain.facets(part.on, f"{part.key}.on")
            require_surface(domain, part.on, f"{part.key}.on")
        for part in contacts:
            numbers = np.unique(domain.parts[domain.owners(domain.facets(part.on))])
            bodies = set[int]().union(*domain.comm.allgather(numbers.tolist()))
            if part.against and set(part.on) == set(part.against) and len(bodies) < 2:
                facets = domain.facets(part.on)
                owned = domain.mesh.topology.index_map(domain.dim - 1).size_local
                normals, _ = domain.area_normals(facets[facets < owned])
                squares = domain.comm.allreduce(normals.T @ normals)
                across = np.round(np.linalg.eigh(squares)[1][:, -1], 2)
                first, name = part.on[0], ", ".join(part.on)
                lips = ", ".join(
                    f"{first}_{number}: {{on: [{name}], facing: {list(map(float, way + 0.0))}}}"
                    for number, way in ((1, across), (2, -across))
                )
                raise InputError(
                    f"{name} belongs to one body; where it holds both lips of a cut, give each lip "
                    f"a name, by mesh.parts: {{{lips}}}, for on and for against",
                    f"{part.key}.against",
                )

    def require_free(self, contacts: Sequence[Contact]) -> None:
        """Raise InputError for a condition that holds Gamma_C across; collective.

        A script may do so: contact then has nothing to do there.
        """
        domain = self.domain
        facets = [
            np.empty(0, dtype=np.int32),
            *(domain.facets(part.on, f"{part.key}.on") for part in contacts),
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

    def features(self, contacts: Sequence[Contact], clock: Clock) -> Iterator[str]:
        """Warnings about data that change between the points in use, but for loads; collective.

        Raises InputError for a pole there.
        """
        domain = self.domain
        every = np.arange(len(domain.parts), dtype=np.int32)
        for items, advice, relative in (
            ((*self.elasticity, *self.limits), _ADVICE, "each"),
            (self.eigenstrains, _ADVICE_ON_CELLS, "all"),
        ):
            for item in items:
                cells = every if item.cells is None else item.cells
                inside = expressions(item.given) if isinstance(item.given, Concept) else ()
                for place, value, _ in inside:
                    entities = Entities.of(domain, domain.dim, cells)
                    key, times = item.key_of(*place), clock.some_times
                    yield from features(entities, value, key, advice, relative, times)
        for held in (*self.held, *self.springs):
            for place, value, _ in expressions(held):
                facets = Entities.of(domain, domain.dim - 1, domain.facets(held.on))
                key, times = dotted(held.key, *place), clock.some_times
                yield from features(facets, value, key, _ADVICE_ON_FACETS, times=times)
        for contact in contacts:
            mu = None if contact.friction is None else contact.friction.coefficient
            if mu is None or mu.expression is None:
                continue
            key = contact.friction_key("coefficient")
            facets = Entities.of(domain, domain.dim - 1, domain.facets(contact.on))
            # Friction may begin with the slip; from the size of the body on the slip is as good as
            # endless.
            slips = [0.0, _SOME_SLIP * domain.extent, domain.extent]
            for slip in slips if "s" in mu.expression.names else slips[:1]:
                if found := features(facets, mu, key, _ADVICE_ON_FACETS, s=slip):
                    yield from found
                    break
