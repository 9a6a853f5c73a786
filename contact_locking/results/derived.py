"""From a solved displacement to the fields, the contact points and the numbers of the summary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from contact_locking import _compat, compiled, forms
from contact_locking.coefficients import Material
from contact_locking.convex import tangential_part
from contact_locking.domain import Domain
from contact_locking.locking import locking_stress
from contact_locking.material import strain
from contact_locking.ordering import along_curves, facets_of, lexicographic
from contact_locking.solution import OPEN, SLIP, STICK, ContactPoints, joined
from contact_locking.solver.multipliers import Multipliers
from contact_locking.system import FrictionBound

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# |eps| >= M (1 - 1e-6) counts as locked.
_LOCKED_MARGIN = 1e-6
# The regularised law approaches its bound but never reaches it; from 99 % on a point slips.
_SLIP_SHARE = 0.99


class BodyFields:
    """P0 fields of the body, interpolated exactly (P1 strains are constant in a cell)."""

    def __init__(
        self,
        domain: Domain,
        u: fem.Function,
        data: forms.ProblemData,
        m: Material,
        multipliers: Multipliers | None = None,
    ) -> None:
        eps, tensor = strain(u), (domain.dim, domain.dim)
        stress = data.elastic_stress(eps)
        norm = ufl.sqrt(ufl.inner(eps, eps))
        self.strain_norm = _p0(domain, norm, "strain_norm")
        self.elastic_stress = _p0(domain, stress, "elastic_stress", tensor)
        if multipliers is None:
            locking = locking_stress(eps, data.inverse_limit, data.n)
            self.locking_stress = _p0(domain, locking, "locking_stress", tensor)
        else:
            self.locking_stress = multipliers.locking_stress
        self.locking_limit = m.limit
        self.locked = fem.Function(m.limit.function_space, name="locked")
        threshold = m.limit.x.array * (1.0 - _LOCKED_MARGIN)
        self.locked.x.array[:] = self.strain_norm.x.array >= threshold

    def largest_overstrain(self, domain: Domain) -> float:
        """``max |eps|/M - 1`` over the body; collective."""
        ratio = self.strain_norm.x.array / self.locking_limit.x.array
        return float(domain.comm.allreduce(ratio.max(initial=0.0), op=MPI.MAX)) - 1.0


class ContactFields:
    """Nodal fields of Gamma_C, as arrays over the owned nodes."""

    def __init__(
        self,
        bound: FrictionBound,
        u: fem.Function,
        data: forms.ProblemData,
        multipliers: Multipliers | None = None,
    ) -> None:
        assert data.contact is not None
        surface = self.surface = bound.surface
        self.normal = data.contact.normal.x.array.reshape(-1, surface.domain.dim)[surface.blocks]
        self.u_normal = surface.average(ufl.inner(u, data.contact.normal))()
        self.u_tangent = surface.average(tangential_part(u, data.contact.normal))()
        self.gap = data.contact.gap.x.array[surface.nodes]
        if multipliers is None:
            self.pressure = surface.average(forms.pressure(u, data))()
            self.traction = 0.0 - surface.average(forms.friction(u, data))()
            touches = self.pressure > 0.0
        else:
            self.pressure, traction = multipliers.pressure, 0.0 - multipliers.friction
            along = np.einsum("ki,ki->k", traction, self.normal)[:, None]
            self.traction = traction - along * self.normal
            touches = multipliers.touches
        self.smoothed_stress = -bound.smoothing.apply(self.pressure)
        self.bound = bound.values.copy()
        slips = np.linalg.norm(self.traction, axis=1) >= _SLIP_SHARE * self.bound
        self.state = np.where(touches, np.where(slips, SLIP, STICK), OPEN)

    def gather(self) -> tuple[ContactPoints, IntArray] | None:
        """All points and facets on rank 0, in an order that no distribution changes; else None.

        They balance the loads as the fields do: a solver with multipliers leaves open points the
        pressure that its tolerance allows, some 1e-7 of the peak.
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
        """The keys of summary.json that belong to Gamma_C; collective."""
        surface = self.surface
        force = 0.0 - surface.integral(self.pressure[:, None] * self.normal)
        penetration = float(np.max(self.u_normal - self.gap, initial=0.0))
        return {
            "penetration_max": float(surface.domain.comm.allreduce(penetration, op=MPI.MAX)),
            "contact_force": force.tolist(),
            "friction_force": surface.integral(self.traction).tolist(),
            "contact_area": float(surface.integral((self.state != OPEN).astype(float))),
            "slip_area": float(surface.integral((self.state == SLIP).astype(float))),
        }


def gather_contacts(
    contacts: Sequence[ContactFields], domain: Domain
) -> tuple[ContactPoints | None, IntArray | None]:
    """The points and the facets of all contacts on rank 0, otherwise None; collective."""
    gathered = [contact.gather() for contact in contacts]
    if domain.comm.rank != 0:
        return None, None
    return joined([part for part in gathered if part is not None], domain.dim)


def no_contact_summary(dim: int) -> dict[str, Any]:
    """The same keys for a body without Gamma_C."""
    return {
        "penetration_max": 0.0,
        "contact_force": [0.0] * dim,
        "friction_force": [0.0] * dim,
        "contact_area": 0.0,
        "slip_area": 0.0,
    }


def body_summary(
    domain: Domain, u: fem.Function, data: forms.ProblemData, fields: BodyFields
) -> dict[str, Any]:
    """Energies, strains and sizes; collective."""
    dofmap = u.function_space.dofmap
    owned = domain.mesh.topology.index_map(domain.dim).size_local
    largest = float(np.max(fields.strain_norm.x.array[:owned], initial=0.0))
    one = fem.Constant(domain.mesh, 1.0)
    return {
        "dofs": int(dofmap.index_map.size_global * dofmap.index_map_bs),
        "cells": domain.num_cells,
        "ranks": domain.comm.size,
        "dolfinx": dolfinx.__version__,
        "compliance": integral(domain, forms.external_work(u, data)),
        "elastic_energy": integral(domain, 0.5 * forms.elastic_form(u, u, data)),
        "strain_norm_max": float(domain.comm.allreduce(largest, op=MPI.MAX)),
        "locked_fraction": integral(domain, fields.locked * data.dx)
        / integral(domain, one * data.dx),
    }


def integral(domain: Domain, form: Expr) -> float:
    """The value of a functional; collective."""
    return float(domain.comm.allreduce(fem.assemble_scalar(compiled.form(form))))


def _p0(domain: Domain, expr: Expr, name: str, shape: tuple[int, ...] = ()) -> fem.Function:
    space = fem.functionspace(domain.mesh, ("DG", 0, shape) if shape else ("DG", 0))
    function = fem.Function(space, name=name)
    function.interpolate(_compat.interpolation_expression(expr, space))
    function.x.scatter_forward()
    return function
