"""Nodal fields of the contacts of a solved displacement, and multipliers of the penalty laws."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking import _compat
from contact_locking.arrays import LARGEST, FloatArray, IntArray
from contact_locking.contact.nodal_contact import BoundsInForce, NodalContact
from contact_locking.fem import compiled
from contact_locking.fem.spaces import Element, make_nodal
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import maximum, minimum, peak
from contact_locking.problem import forms
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.problem.system import System
from contact_locking.results.between_nodes import Entry, entry_between_nodes
from contact_locking.results.contact_points import (
    OPEN,
    SLIP,
    STICK,
    ContactPoints,
    along_curves,
    facets_of,
    joined,
    lexicographic,
)
from contact_locking.solver.task import ContactForces, Multipliers

# Regularised friction never reaches its bound: points above this share count as slipping.
_SLIP_SHARE = 0.99

# The scalar fields on Gamma_C, and the attribute of ContactFields with the nodal values.
_SCALAR_FIELDS = {
    "contact_pressure": "pressure",
    "smoothed_stress": "smoothed_stress",
    "friction_bound": "bound",
}

# Nodes below this share of the largest pressure may be at the edge of contact.
_PRESSES = 0.01


class ContactFields:
    """The nodal fields of one contact, as arrays over its k owned nodes.

    - ``normal``, ``gap``, ``u_normal``, ``u_tangent``: nu, gap, u_nu, u_tau
    - ``increment``, ``slip``: the slip (k, d) of the step, and the accumulated length (k,)
    - ``old_place``, ``old_slip``: ``u_{k-1,tau}`` (k, d) and the slip (k,) before the step
    - ``pressure``, ``traction``, ``smoothed_stress``, ``bound``: p, sigma_tau, R sigma_nu and G
    - ``state``, ``holds``, ``free``: OPEN, STICK or SLIP; no slip at all; not held: (k,) each
    - ``drag``, ``travel``: the foundation's motion in the step (k, d), and its travel (d,)
    - ``tool``: the foundation itself, None for a gap
    """

    def __init__(
        self, contact: NodalContact, u: fem.Function, forces: ContactForces, bounds: BoundsInForce
    ) -> None:
        self.contact, self.surface = contact, contact.surface
        self.normal, self.gap = contact.normals, contact.gaps
        self.u_normal, self.u_tangent = contact.split(u)
        self.increment, self.slip = contact.increment(u), contact.slips(u)
        self.old_place, self.old_slip = contact.references, contact.state.slip
        frame = contact.surface.frame
        self.paired_at = None if frame is None else frame.displacement
        # Later solves move the foundation itself.
        self.tool, self.travel = contact.foundation.now, np.array(contact.travel)
        self.drag, self.free = contact.drag, contact.free
        self.pressure = forces.pressure
        self.traction = contact.split_nodal(0.0 - forces.friction)[1]
        self.smoothed_stress = -contact.friction.smoothing.apply(self.pressure)
        self.bound, self.regularisation = bounds[contact], contact.regularisation
        slips = np.linalg.norm(self.traction, axis=1) >= _SLIP_SHARE * self.bound
        slips &= contact.slides
        self.state = np.where(forces.touches, np.where(slips, SLIP, STICK), OPEN)
        # Regularised friction needs a slip.
        self.holds = (self.state == STICK) & (self.regularisation == 0.0)
        self._u = u

    @cached_property
    def entry(self) -> Entry:
        """The deepest entry of the foundation between the nodes; the first use is collective.

        Two bodies meet in the mean over a facet, and may overlap between the nodes by the error of
        the mesh.
        """
        if self.surface.is_paired:
            return Entry()
        return entry_between_nodes(self.contact, self._u, self.state != OPEN)

    @cached_property
    def apart(self) -> float:
        """The distance of touching bodies, as :meth:`ContactSurface.apart`; collective.

        It is 0 with ``pair: once``, because bodies then touch in the linearised sense.
        """
        if not self.contact.pairs_anew:
            return 0.0
        comm = self.surface.domain.comm
        presses = (self.state != OPEN) & (self.pressure > _PRESSES * maximum(comm, self.pressure))
        entered = maximum(comm, np.where(self.free, self.u_normal - self.gap, 0.0))
        return self.surface.apart(self._u.x.array, presses, self.gap, max(entered, 0.0))

    def gather(self) -> tuple[ContactPoints, IntArray] | None:
        """All points and facets on rank 0, otherwise None; collective.

        The order does not depend on the distribution.  The table keeps the small pressures at open
        points that the solver's tolerance permits, so that it balances the loads.
        """
        names = [column.name for column in dataclasses.fields(ContactPoints)[1:-1]]
        number = np.zeros(len(self.state), dtype=np.int64)
        columns = [self.surface.points, *(getattr(self, name) for name in names), number]
        gathered = [self.surface.domain.comm.gather(column) for column in columns]
        corners = self.surface.facet_corners()
        whole = [np.concatenate(parts) for parts in gathered if parts is not None]
        if corners is None:
            return None
        x = whole[0]
        order = along_curves(x, corners) if x.shape[1] == 2 else lexicographic(x)
        points = ContactPoints(*(column[order] for column in whole))
        return points, facets_of(points.x, corners)


@dataclass(frozen=True)
class Contacts:
    """Some contacts of a body; the methods take functions of their fields and are collective."""

    domain: Domain
    fields: tuple[ContactFields, ...]

    def integral(self, density: Callable[[ContactFields], FloatArray], size: int = 0) -> Any:
        """The integral of a density (k,), or (k, size), over Gamma_C of the contacts."""
        integrals = (fields.surface.integral(density(fields)) for fields in self.fields)
        return sum(integrals, np.zeros(size) if size else 0.0)

    def peak(self, values: Callable[[ContactFields], FloatArray]) -> Any:
        """The largest of values (k,) and its place, as :func:`~contact_locking.parallel.peak`."""
        nodal = np.concatenate([np.empty(0), *(values(fields) for fields in self.fields)])
        places = [
            np.empty((0, self.domain.dim)),
            *(fields.surface.points for fields in self.fields),
        ]
        return peak(self.domain.comm, nodal, np.concatenate(places))


def gather_contacts(
    contacts: Sequence[ContactFields], domain: Domain
) -> tuple[ContactPoints | None, IntArray | None]:
    """The points and the facets of all contacts on rank 0, otherwise None; collective."""
    gathered = [contact.gather() for contact in contacts]
    if domain.comm.rank != 0:
        return None, None
    return joined([of_contact for of_contact in gathered if of_contact is not None], domain.dim)


def on_gamma_c(contacts: Sequence[ContactFields], u: fem.Function) -> dict[str, fem.Function]:
    """The fields of all contacts as nodal functions, zero off Gamma_C; collective.

    At a node of several contacts the value is the mean, weighted by the nodal weights of the
    contacts, so that the nodal forces add up; the state is the largest state.  Control values give
    the field that has these control values, so that its integral is the force.
    """
    vectors = u.function_space
    scalars = _compat.collapse(vectors.sub(0))[0]
    dim = u.ufl_shape[0]
    functions = {name: fem.Function(scalars, name=name) for name in _SCALAR_FIELDS}
    state = fem.Function(scalars, name="contact_state")
    functions["tangential_traction"] = fem.Function(vectors, name="tangential_traction")
    area = np.zeros(len(scalars.tabulate_dof_coordinates()))
    for fields in contacts:
        np.add.at(area, fields.surface.nodes, fields.surface.weights)
    for fields in contacts:
        nodes = fields.surface.nodes
        share = fields.surface.weights / area[nodes]
        for name, attribute in _SCALAR_FIELDS.items():
            functions[name].x.array[nodes] += share * getattr(fields, attribute)
        state.x.array[nodes] = np.maximum(state.x.array[nodes], fields.state)
        tractions = functions["tangential_traction"].x.array.reshape(-1, dim)
        tractions[fields.surface.blocks] += share[:, None] * fields.traction
    state.x.scatter_forward()
    for function in functions.values():
        function.x.scatter_forward()
        make_nodal(function, [fields.surface.controls for fields in contacts])
    return functions | {"contact_state": state}


# A cell is locked if |eps| >= M (1 - 1e-6).
_LOCKED_MARGIN = 1e-6


def _norm(eps: Expr) -> Expr:
    return ufl.sqrt(ufl.inner(eps, eps))


def _angle(u: Expr) -> Expr:
    turn = ufl.skew(ufl.grad(u))
    return ufl.sqrt(0.5 * ufl.inner(turn, turn))


class BodyFields:
    """Fields of the body in the space of strains, with the values at the points of the strains.

    - ``locking_limit``: M of the ball; with other sets of strains the largest ``|eps|`` in K along
      eps(u), so that ``|eps|`` over it is the utilisation of K
    - ``locked``, ``von_mises``: 1 where the utilisation is 1, else 0; None if sigma_zz is unknown
    """

    #: The names of all fields.
    FIELDS = (
        *("strain_norm", "locking_limit", "locked", "elastic_stress", "locking_stress"),
        *("von_mises", "locking_parts"),
    )

    def __init__(self, problem: DiscreteProblem, system: System, multipliers: Multipliers) -> None:
        self.domain, self.system, limits = problem.domain, system, problem.limits
        self.displacement = system.u
        data, self._kept = system.data, system.kept
        self._element, self._dx = data.element, data.dx
        eps = data.strain(system.u)
        norm = functools.partial(_norm, eps)
        self.strain_norm = self._at_points(data.element, norm, "strain_norm")
        stress = functools.partial(data.elastic_stress, eps)
        self.elastic_stress = self._at_points(data.element, stress, "elastic_stress")
        self.locking_stress, self.locking_parts = multipliers.locking_stress, multipliers.parts
        shares = [(law, functools.partial(law.utilisation, eps)) for law in data.limits]
        #: The utilisation of each set of strains but the ball.
        self.utilisations = [
            self._at_points(data.element, share, law.name, number)
            for number, (law, share) in enumerate(shares)
        ]
        self.locking_limit = limits.limit
        self.is_limited = (
            bool(limits.others) or minimum(self.domain.comm, limits.limit.x.array) < np.inf
        )
        if not data.only_ball:
            self.locking_limit = self._limit_along_strain(data, limits.limit)
        self.locked = fem.Function(limits.limit.function_space, name="locked")
        threshold = self.locking_limit.x.array * (1.0 - _LOCKED_MARGIN)
        self.locked.x.array[:] = self.strain_norm.x.array >= threshold
        at_peaks = data.element.at_peaks
        self._peaks = self.strain_norm
        if at_peaks is not data.element:
            self._peaks = self._at_points(at_peaks, norm, "strain_norm")
        self._limit_at_peaks = limits.limit_at_peaks
        self._utilisations_at_peaks = [
            self._at_points(at_peaks, share, law.name, number)
            for number, (law, share) in enumerate(shares)
        ]
        self.von_mises = self._von_mises(problem)

    def _at_points(
        self, element: Element, made: Callable[[], Expr], name: str, number: int | None = None
    ) -> fem.Function:
        """The values of an expression, which is compiled once for each name and number."""

        def compile_expression() -> tuple[fem.FunctionSpace, fem.Expression]:
            expr = made()
            space = element.shared_strain_space(self._kept, self.domain.mesh, expr.ufl_shape)
            return space, compiled.interpolation(expr, space)

        at = "peaks" if element is not self._element else "points"
        space, values = self._kept((name, number, at), compile_expression)
        function = fem.Function(space, name=name)
        function.interpolate(values)
        function.x.scatter_forward()
        return function

    @functools.cached_property
    def rotation(self) -> fem.Function:
        """The angle ``|skew grad u|/sqrt(2)`` at the points of the strains; collective."""
        return self._at_points(
            self._element, functools.partial(_angle, self.displacement), "rotation"
        )

    def share(self, marks: FloatArray) -> float:
        """The share of the body where ``marks`` (k,) of the space of strains are 1; collective."""
        weights = self._kept("weights", self._weights)
        # The same rounding in both sums makes the share of the whole body exactly 1.
        shares = np.array([weights @ marks, weights @ (1.0 - marks)])
        marked, unmarked = self.domain.comm.allreduce(shares)
        return float(marked / (marked + unmarked))

    def _weights(self) -> FloatArray:
        """The integrals (k,) of the functions of the space of strains over owned cells."""
        test = ufl.TestFunction(self.locked.function_space)
        return fem.assemble_vector(compiled.form(test * self._dx)).array

    def _limit_along_strain(self, data: forms.ProblemData, ball: fem.Function) -> fem.Function:
        """The largest ``|eps|`` in K along the present strain.

        It is `LARGEST` where K has limits but none in that direction, and inf where K has none.
        """
        limit = ball.copy()
        used = np.max([field.x.array for field in self.utilisations], axis=0)
        is_limited = np.max([field.inverse_limit.x.array for field in data.limits], axis=0) > 0.0
        along = np.where(is_limited, LARGEST, np.inf)
        where = used > 1.0 / LARGEST
        along[where] = self.strain_norm.x.array[where] / used[where]
        limit.x.array[:] = np.minimum(limit.x.array, along)
        return limit

    def _von_mises(self, problem: DiscreteProblem) -> fem.Function | None:
        """``sqrt(3/2) |dev sigma|`` of the whole stress, at the points of the strains; collective.

        In plane strain the stress across the plane is elastic if the ball, whose multiplier is
        parallel to the strain, is the only set; in plane stress it is zero.
        """
        points = problem.limits.points
        elastic = points.values(self.elastic_stress)
        size, stress = elastic.shape[1], np.zeros((len(elastic), 3, 3))
        stress[:, :size, :size] = elastic + points.values(self.locking_stress)
        if size == 2:
            across = problem.material.across(elastic)
            if across is None or (problem.material.in_space and not self.system.data.only_ball):
                return None
            stress[:, 2, 2] = across
        stress -= np.trace(stress, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 3.0
        field = fem.Function(points.space, name="von_mises")
        points.write(field, np.sqrt(1.5) * np.linalg.norm(stress, axis=(1, 2)))
        return field

    def largest(self, values: fem.Function, over: fem.Function | None = None) -> float:
        """The largest value at the points of the strains, as a multiple of ``over``; collective."""
        ratio = values.x.array if over is None else values.x.array / over.x.array
        return maximum(self.domain.comm, ratio)

    def peak(self, field: fem.Function) -> Any:
        """The largest norm of the values of a field at its points, and its place; collective."""
        space, owned = field.function_space, field.function_space.dofmap.index_map.size_local
        values = np.linalg.norm(field.x.array.reshape(-1, space.dofmap.bs)[:owned], axis=1)
        places = space.tabulate_dof_coordinates()[:owned, : self.domain.dim]
        return peak(self.domain.comm, values, places)

    @property
    def peaks(self) -> tuple[float, float]:
        """``max |eps|`` and ``max |eps|/M`` over the whole of every cell; collective."""
        used = [self.largest(share) for share in self._utilisations_at_peaks]
        used.append(self.largest(self._peaks, self._limit_at_peaks))
        return self.largest(self._peaks), max(used)

    def about_sets(self) -> list[dict[str, Any]]:
        """The entries of summary.json about the sets of strains except the ball; collective."""
        return [
            {
                "name": utilisation.name,
                "utilisation_max": self.largest(utilisation),
                "locked_fraction": self.share(
                    (utilisation.x.array >= 1.0 - _LOCKED_MARGIN).astype(float)
                ),
            }
            for utilisation in self.utilisations
        ]
