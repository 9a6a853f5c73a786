"""Fields, contact points and summary of a solved displacement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking import _compat
from contact_locking.arrays import IntArray
from contact_locking.laws.elasticity import strain
from contact_locking.parallel import maximum
from contact_locking.problem import compiled, forms
from contact_locking.problem.coefficients import Material
from contact_locking.problem.contact import Contact
from contact_locking.problem.domain import Domain
from contact_locking.problem.spaces import Element
from contact_locking.problem.trace import make_nodal
from contact_locking.results.contact_points import OPEN, SLIP, STICK, ContactPoints, joined
from contact_locking.results.ordering import along_curves, facets_of, lexicographic
from contact_locking.solver.multipliers import ContactForces, Multipliers

# A cell is locked if |eps| >= M (1 - 1e-6).
_LOCKED_MARGIN = 1e-6
# The regularised friction traction never reaches the bound: a point slips from 99 % of the bound
# on.
_SLIP_SHARE = 0.99

# The scalar fields on Gamma_C, each with the attribute of ContactFields that holds the nodal
# values.
_SCALAR_FIELDS = {
    "contact_pressure": "pressure",
    "smoothed_stress": "smoothed_stress",
    "contact_state": "state",
    "friction_bound": "bound",
}


class BodyFields:
    """Fields of the body in the space of strains, with the values at the points of the strains.

    ``locking_limit`` is M of the ball.  With other sets of strains it is the largest ``|eps|`` in K
    along the strain eps(u), so that ``|eps|`` over it is the utilisation of K: the largest of all
    sets.  Cells are locked that use up their limit.
    """

    def __init__(
        self,
        domain: Domain,
        u: fem.Function,
        data: forms.ProblemData,
        m: Material,
        found: Multipliers,
    ) -> None:
        eps, tensor = strain(u), (domain.dim, domain.dim)
        stress = data.elastic_stress(eps)
        norm = ufl.sqrt(ufl.inner(eps, eps))
        self.strain_norm = _at_points(data.element, domain, norm, "strain_norm")
        self.elastic_stress = _at_points(data.element, domain, stress, "elastic_stress", tensor)
        self.locking_stress, self.locking_parts = found.locking_stress, found.parts
        limits = [(item, item.utilisation(eps)) for item in data.limits]
        #: The utilisation of each set of strains but the ball.
        self.utilisations = [
            _at_points(data.element, domain, share, item.name) for item, share in limits
        ]
        self.locking_limit = m.limit if data.only_ball else self._limit_along_strain(m.limit)
        self.locked = fem.Function(m.limit.function_space, name="locked")
        threshold = self.locking_limit.x.array * (1.0 - _LOCKED_MARGIN)
        self.locked.x.array[:] = self.strain_norm.x.array >= threshold
        at_peaks = data.element.at_peaks
        self._peaks = self.strain_norm
        if at_peaks is not data.element:
            self._peaks = _at_points(at_peaks, domain, norm, "strain_norm")
        self._limit_at_peaks = m.limit_at_peaks
        self._utilisations_at_peaks = [
            _at_points(at_peaks, domain, share, item.name) for item, share in limits
        ]

    def _limit_along_strain(self, ball: fem.Function) -> fem.Function:
        """The largest ``|eps|`` in K along the present strain, inf where nothing limits that."""
        limit = ball.copy()
        used = np.max([item.x.array for item in self.utilisations], axis=0)
        where = used > 0.0
        along = np.full_like(used, np.inf)
        along[where] = self.strain_norm.x.array[where] / used[where]
        limit.x.array[:] = np.minimum(limit.x.array, along)
        return limit

    def largest_overstrain(self, domain: Domain) -> float:
        """``max |eps|/M - 1`` over the points of the strains; collective."""
        return _largest(domain, self.strain_norm, self.locking_limit) - 1.0

    def peaks(self, domain: Domain) -> tuple[float, float]:
        """``max |eps|`` and ``max |eps|/M - 1`` over the whole of every cell; collective."""
        used = [_largest(domain, share) for share in self._utilisations_at_peaks]
        used.append(_largest(domain, self._peaks, self._limit_at_peaks))
        return _largest(domain, self._peaks), max(used) - 1.0


def _largest(domain: Domain, values: fem.Function, over: fem.Function | None = None) -> float:
    """The largest value at the points of the strains, as a multiple of ``over``; collective."""
    ratio = values.x.array if over is None else values.x.array / over.x.array
    return maximum(domain.comm, ratio)


class ContactFields:
    """The nodal fields of one contact, as arrays over its owned nodes."""

    def __init__(self, contact: Contact, u: fem.Function, forces: ContactForces) -> None:
        self.contact, self.surface = contact, contact.surface
        self.normal, self.gap = contact.normals, contact.gaps
        self.u_normal, self.u_tangent = contact.split(u)
        # The slip of the step, and the accumulated slip.
        self.increment, self.slip = contact.increment(u), contact.slips(u)
        self.pressure = forces.pressure
        self.traction = contact.split_nodal(0.0 - forces.friction)[1]
        self.smoothed_stress = -contact.friction.smoothing.apply(self.pressure)
        self.bound = contact.bounds.copy()
        slips = np.linalg.norm(self.traction, axis=1) >= _SLIP_SHARE * self.bound
        self.state = np.where(forces.touches, np.where(slips, SLIP, STICK), OPEN)

    def gather(self) -> tuple[ContactPoints, IntArray] | None:
        """All points and facets on rank 0, otherwise None; collective.

        The order does not depend on the distribution.  A solver with multipliers leaves a small
        pressure at open points, within its tolerance.  This pressure stays in the table, so that
        the table balances the loads.
        """
        columns = (
            self.surface.points,
            self.normal,
            self.u_normal,
            self.u_tangent,
            self.gap,
            self.pressure,
            self.traction,
            self.bound,
            self.state,
            np.zeros(len(self.state), dtype=np.int64),
        )
        gathered = [self.surface.domain.comm.gather(column) for column in columns]
        corners = self.surface.facet_corners()
        whole = [np.concatenate(parts) for parts in gathered if parts is not None]
        if corners is None:
            return None
        x = whole[0]
        order = along_curves(x, corners) if x.shape[1] == 2 else lexicographic(x)
        points = ContactPoints(*(column[order] for column in whole))
        return points, facets_of(points.x, corners)

    def summary(self) -> dict[str, Any]:
        """Resultants and areas of this contact; collective."""
        surface = self.surface
        force = 0.0 - surface.integral(self.pressure[:, None] * self.normal)
        return {
            "penetration_max": maximum(surface.domain.comm, self.u_normal - self.gap),
            "contact_force": force.tolist(),
            "friction_force": surface.integral(self.traction).tolist(),
            "contact_area": float(surface.integral((self.state != OPEN).astype(float))),
            "slip_area": float(surface.integral((self.state == SLIP).astype(float))),
        }


def penalised(domain: Domain, u: fem.Function, data: forms.ProblemData) -> Multipliers:
    """Locking stress (23), pressure (25) and friction (22) of u by the penalty laws; collective."""
    forces = []
    for contact in data.contacts:
        limited = contact.limited(u)
        pressure = contact.surface.average(forms.pressure(limited, contact, data))()
        friction = contact.surface.average(forms.friction(limited, contact))()
        forces.append(ContactForces(pressure, friction, pressure > 0.0))
    found = Multipliers.none(data, domain.mesh, tuple(forces))
    for item, part in zip(data.sets, found.parts, strict=True):
        law = item.multiplier(strain(u), data.n)
        part.interpolate(_compat.interpolation_expression(law, part.function_space))
        part.x.scatter_forward()
    found.add_up(data)
    return found


def contact_summary(contacts: Sequence[ContactFields], dim: int) -> dict[str, Any]:
    """The keys of summary.json about all contacts together, and about each contact; collective."""
    total: dict[str, Any] = {
        "penetration_max": 0.0,
        "contact_force": [0.0] * dim,
        "friction_force": [0.0] * dim,
        "contact_area": 0.0,
        "slip_area": 0.0,
    }
    found = [fields.summary() for fields in contacts]
    for one in found:
        total["penetration_max"] = max(total["penetration_max"], one["penetration_max"])
        for key in ("contact_force", "friction_force"):
            total[key] = np.add(total[key], one[key]).tolist()
        for key in ("contact_area", "slip_area"):
            total[key] += one[key]
    named = zip(contacts, found, strict=True)
    return total | {"contacts": [{"on": list(c.contact.on), **one} for c, one in named]}


def gather_contacts(
    contacts: Sequence[ContactFields], domain: Domain
) -> tuple[ContactPoints | None, IntArray | None]:
    """The points and the facets of all contacts on rank 0, otherwise None; collective."""
    gathered = [contact.gather() for contact in contacts]
    if domain.comm.rank != 0:
        return None, None
    return joined([part for part in gathered if part is not None], domain.dim)


def on_gamma_c(contacts: Sequence[ContactFields], u: fem.Function) -> dict[str, fem.Function]:
    """The fields of all contacts as nodal functions, zero off Gamma_C; collective.

    At a node of several contacts the value is the mean, weighted by the nodal weights of the
    contacts, so that the nodal forces add up; the state is the largest state.  Of control values
    the field is the one with these control values: its integral is the force.
    """
    vectors = u.function_space
    scalars = _compat.collapse(vectors.sub(0))[0]
    dim = u.ufl_shape[0]
    found = {name: fem.Function(scalars, name=name) for name in _SCALAR_FIELDS}
    found["tangential_traction"] = fem.Function(vectors, name="tangential_traction")
    area = np.zeros(len(scalars.tabulate_dof_coordinates()))
    for fields in contacts:
        np.add.at(area, fields.surface.nodes, fields.surface.weights)
    for fields in contacts:
        nodes = fields.surface.nodes
        share = fields.surface.weights / area[nodes]
        for name, attribute in _SCALAR_FIELDS.items():
            values = found[name].x.array
            if name == "contact_state":
                values[nodes] = np.maximum(values[nodes], fields.state)
            else:
                values[nodes] += share * getattr(fields, attribute)
        tractions = found["tangential_traction"].x.array.reshape(-1, dim)
        tractions[fields.surface.blocks] += share[:, None] * fields.traction
    for name, function in found.items():
        function.x.scatter_forward()
        if name != "contact_state":
            make_nodal(function, [fields.surface.limited for fields in contacts])
    return found


def body_summary(
    domain: Domain, u: fem.Function, data: forms.ProblemData, fields: BodyFields
) -> dict[str, Any]:
    """The keys of summary.json about the body: energies, strains and sizes; collective."""
    dofmap = u.function_space.dofmap
    owned = fields.strain_norm.function_space.dofmap.index_map.size_local
    one = fem.Constant(domain.mesh, 1.0)
    largest, overstrain = fields.peaks(domain)
    volume = integral(domain, one * data.dx)
    return {
        "discretisation": data.element.facts(),
        "dofs": int(dofmap.index_map.size_global * dofmap.index_map_bs),
        "cells": domain.num_cells,
        "ranks": domain.comm.size,
        "dolfinx": dolfinx.__version__,
        "compliance": integral(domain, forms.external_work(u, data)),
        "elastic_energy": integral(domain, 0.5 * forms.elastic_form(u, u, data)),
        "strain_norm_max": maximum(domain.comm, fields.strain_norm.x.array[:owned]),
        "strain_norm_max_in_cells": largest,
        "overstrain_max": max(overstrain, 0.0),
        "locked_fraction": integral(domain, fields.locked * data.dx) / volume,
        "strain_sets": [_about_set(domain, share, data) for share in fields.utilisations],
    }


def _about_set(
    domain: Domain, utilisation: fem.Function, data: forms.ProblemData
) -> dict[str, Any]:
    """The entry of summary.json about one set of strains beside the ball; collective."""
    used_up = utilisation.copy()
    used_up.x.array[:] = utilisation.x.array >= 1.0 - _LOCKED_MARGIN
    one = fem.Constant(domain.mesh, 1.0)
    return {
        "name": utilisation.name,
        "utilisation_max": _largest(domain, utilisation),
        "locked_fraction": integral(domain, used_up * data.dx) / integral(domain, one * data.dx),
    }


def integral(domain: Domain, form: Expr) -> float:
    """The value of a functional; collective."""
    return float(domain.comm.allreduce(fem.assemble_scalar(compiled.form(form))))


def _at_points(
    element: Element, domain: Domain, expr: Expr, name: str, shape: tuple[int, ...] = ()
) -> fem.Function:
    space = element.strain_space(domain.mesh, shape)
    function = fem.Function(space, name=name)
    function.interpolate(_compat.interpolation_expression(expr, space))
    function.x.scatter_forward()
    return function
