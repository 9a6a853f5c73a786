"""The discrete problem of a parameter set: everything that exists before the first solve."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI

from contact_locking import domain as domains
from contact_locking import forms, foundation
from contact_locking.coefficients import AXES, Material, build_material, evaluate
from contact_locking.conditions import (
    ComponentCondition,
    Constraints,
    constrain,
)
from contact_locking.domain import Domain
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import parse
from contact_locking.friction_law import FrictionLaw
from contact_locking.groups import groups
from contact_locking.loads import build_loads
from contact_locking.parallel import agree
from contact_locking.parameters import ContactParameters, LoadParameters, Parameters, Smoothing
from contact_locking.parts import Held, check_parts_held
from contact_locking.plausibility import about_the_gap
from contact_locking.smoothing import Convolution, HelmholtzFilter, Identity
from contact_locking.smoothing import Smoothing as SmoothingOperator
from contact_locking.surface import ContactSurface
from contact_locking.system import FrictionBound

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

# Without a radius R averages over this share of the extent of Gamma_C, and over the neighbours of
# each node at least: the kernel vanishes at its radius.
_DEFAULT_RADIUS_SHARE, _DEFAULT_RADIUS_FACETS = 0.1, 2.0
# From this share of the extent on, R by a filter is the mean over Gamma_C to nine digits.
_LARGEST_RADIUS_SHARE = 1e4
# A friction coefficient is zero where it is negative by less than this share of its largest value.
_COEFFICIENT_ROUNDING = 1e-12


@dataclass
class Problem:
    """Everything that exists before the first solve; made by :func:`assemble`."""

    parameters: Parameters
    domain: Domain
    material: Material
    data: forms.ProblemData
    u: fem.Function
    constraints: Constraints
    bound: FrictionBound | None
    held: list[Held]
    warnings: list[str]

    @property
    def free(self) -> int:
        """How many rigid motions contact alone holds."""
        return sum(part.free for part in self.held)

    @property
    def sliding(self) -> int:
        """How many of those friction alone holds."""
        return sum(part.sliding for part in self.held)

    def facts(self) -> dict[str, Any]:
        """What would be solved, for ``contact-locking check``; collective."""
        dofmap = self.u.function_space.dofmap
        facts = {
            "dimension": self.domain.dim,
            "cells": self.domain.num_cells,
            "dofs": int(dofmap.index_map.size_global * dofmap.index_map_bs),
            "regions": sorted(self.domain.cell_names),
            "boundary parts": sorted(self.domain.facet_names),
            "groups": groups(self.domain),
            "held by": {part.name: str(part) for part in self.held},
            "smallest eigenvalue of A": self.material.ellipticity,
        }
        if self.bound is not None:
            count = len(self.bound.surface.nodes)
            facts["contact points"] = int(self.domain.comm.allreduce(count))
        return facts


def penalty(parameters: Parameters, young: float) -> tuple[float, float, float]:
    """``n``, ``epsilon`` and the regularisation of friction.

    ``epsilon`` is ``1/n`` unless it is given.  The paper has the same epsilon, a compliance, in
    (22) in the place of a length: Young's modulus makes a length of it where none is given.
    """
    n, epsilon = parameters.penalty.n, parameters.penalty.epsilon
    epsilon = 1.0 / n if epsilon is None else epsilon
    regularisation = parameters.friction.regularisation
    return n, epsilon, young * epsilon if regularisation is None else regularisation


def assemble(parameters: Parameters, comm: MPI.Intracomm, domain: Domain | None = None) -> Problem:
    """Mesh, material, loads, conditions, contact and friction; collective.

    ``domain`` is used where it is given, in place of a new mesh.
    Raises InputError for everything about the data that only the mesh can tell.
    """
    domain = domain or _domain(parameters, comm)
    warnings = [f"{domain.origin}: {warning}" for warning in domain.warnings]
    parameters.check_dimension(domain.dim)
    material = build_material(domain, parameters.material)
    space = fem.functionspace(domain.mesh, ("P", 1, (domain.dim,)))
    _check_parts(domain, parameters)
    constraints = constrain(domain, space, _conditions(domain, parameters.loads))
    n, epsilon, regularisation = penalty(parameters, material.young)
    surface, contact = _contact(domain, space, parameters.contact)
    if surface is not None and contact is not None:
        key = "contact.gap" if parameters.contact.foundation is None else "contact.foundation"
        warnings += about_the_gap(domain, contact.gap.x.array[surface.nodes], key)
    data = forms.ProblemData(
        elastic_stress=material.elastic_stress,
        largest_eigenvalue=material.largest_eigenvalue,
        inverse_limit=material.inverse_limit,
        dx=ufl.Measure("dx", domain=domain.mesh),
        loads=build_loads(domain, parameters.loads, material.stiffness, warnings),
        contact=contact,
        n=fem.Constant(domain.mesh, n),
        epsilon=fem.Constant(domain.mesh, epsilon),
        regularisation=fem.Constant(domain.mesh, regularisation),
    )
    u = fem.Function(space, name="displacement")
    held = check_parts_held(domain, space, data, constraints, surface, parameters)
    bound = None
    if surface is not None:
        assert contact is not None
        normal = contact.normal.x.array.reshape(-1, domain.dim)[surface.blocks]
        free_nodes = surface.free_nodes(normal, constraints.free_dofs(u))
        smoothing = _smoothing(surface, free_nodes, parameters.friction.smoothing, warnings)
        law = _friction_law(comm, parameters.friction.coefficient)
        frictionless = parameters.friction.coefficient == 0
        bound = FrictionBound(surface, smoothing, law, u, data, frictionless)
    return Problem(parameters, domain, material, data, u, constraints, bound, held, warnings)


def _domain(parameters: Parameters, comm: MPI.Intracomm) -> Domain:
    geometry = parameters.mesh.geometry
    if geometry is not None:
        return domains.from_geometry(geometry, comm)
    assert parameters.mesh.file is not None
    return domains.from_file(Path(parameters.mesh.file), comm)


def _check_parts(domain: Domain, parameters: Parameters) -> None:
    """The names exist, and no part is both contact and subject to a displacement condition."""
    contact = domain.facets(parameters.contact.on, "contact.on")
    for i, condition in enumerate(parameters.loads.displacements):
        key = f"loads.displacements.{i}.on"
        both = np.intersect1d(domain.facets(condition.on, key), contact)
        if domain.comm.allreduce(len(both)):
            raise InputError(
                "Gamma_C and Gamma_D overlap: contact and a displacement are both asked for on "
                f"{_quoted(condition.on)}",
                key,
            )


def _conditions(domain: Domain, loads: LoadParameters) -> list[ComponentCondition]:
    wanted = []
    for i, condition in enumerate(loads.displacements):
        for j, value in enumerate(condition.value):
            if value is not None:
                key = f"loads.displacements.{i}.value.{j}"
                field = partial(evaluate, domain.comm, value, key=key)
                wanted.append(ComponentCondition(condition.on, j, field, key))
    return wanted


def _contact(
    domain: Domain, space: fem.FunctionSpace, given: ContactParameters
) -> tuple[ContactSurface | None, forms.ContactData | None]:
    if not given.on:
        return None, None
    surface = ContactSurface(domain, space, given.on)
    points = surface.points.T
    if given.foundation is None:
        gap = evaluate(domain.comm, given.gap, points, "contact.gap")
        normal = surface.body_normals()
    else:
        body = _foundation(given, domain.dim)
        with np.errstate(all="ignore"):
            gap, normal = body.gap(points), body.contact_normal(points).T
        finite = bool(np.isfinite(gap).all() and np.isfinite(normal).all())
        if not domain.comm.allreduce(finite, op=MPI.LAND):
            raise InputError(
                "the distance to it is no number; it lies too far away or is too large",
                "contact.foundation",
            )
        facing = np.sum(normal * surface.body_normals(), axis=1)
        if domain.comm.allreduce(bool(np.any(facing <= 0.0)), op=MPI.LOR):
            raise InputError(
                "the foundation lies behind a part of Gamma_C: there the outward normal of the "
                "body points away from it; turn the half space's normal towards the body, or "
                "take away from contact.on what does not face the foundation",
                "contact.foundation",
            )
    return surface, forms.ContactData(
        ds=surface.ds,
        normal=surface.vector_function(normal, "contact_normal"),
        gap=surface.scalar_function(gap, "gap"),
        bound=surface.scalar_function(np.zeros(len(gap)), "friction_bound"),
    )


def _foundation(given: ContactParameters, dim: int) -> foundation.Foundation:
    assert given.foundation is not None
    half_space, sphere, cylinder = (
        given.foundation.half_space,
        given.foundation.sphere,
        given.foundation.cylinder,
    )
    if half_space is not None:
        return foundation.HalfSpace(tuple(half_space.point), tuple(half_space.normal))
    if sphere is not None:
        return foundation.Round(tuple(sphere.centre), sphere.radius)
    assert cylinder is not None
    axis = None if dim == 2 else tuple(cylinder.axis or (0.0, 1.0, 0.0))
    return foundation.Round(tuple(cylinder.centre), cylinder.radius, axis)


def _smoothing(
    surface: ContactSurface, free: BoolArray, given: Smoothing, warnings: list[str]
) -> SmoothingOperator:
    if given.kernel == "none":
        return Identity()
    comm = surface.domain.comm
    radius = given.radius
    size = surface.domain.facet_diameter(surface.facets)
    places = np.concatenate(comm.allgather(surface.points))
    extent = _extent(places)
    if radius is None:
        radius = max(_DEFAULT_RADIUS_SHARE * extent, _DEFAULT_RADIUS_FACETS * size)
    elif radius < size:
        warnings.append(
            f"friction.smoothing.radius: {radius:g} is smaller than the mesh size {size:.3g} on "
            "Gamma_C, so R hardly smooths; refine the mesh there or enlarge the radius"
        )
    if given.kernel == "convolution":
        return Convolution(comm, surface.whole(free), radius)
    radius = min(radius, _LARGEST_RADIUS_SHARE * extent)
    return HelmholtzFilter(comm, surface.whole(free), surface.laplacian(), radius)


def _extent(places: FloatArray) -> float:
    """How far apart points (k, d) are: from the one farthest from the middle to that from it.

    Of a straight or rectangular Gamma_C the length or diagonal, however it lies.
    """
    place = places.mean(axis=0)
    for _ in range(2):
        distances = np.linalg.norm(places - place, axis=1)
        place = places[np.argmax(distances)]
    return float(distances.max())


def _friction_law(comm: MPI.Intracomm, value: float | str) -> FrictionLaw:
    """``mu(x, s)`` of a number or an expression; to evaluate it is collective."""
    key = "friction.coefficient"
    expression = parse(value, (*AXES, "s"))

    def local(points: FloatArray, slip: FloatArray) -> FloatArray:
        places = dict(zip(AXES, points.T, strict=False))
        return with_key(
            key, lambda: np.broadcast_to(expression.numpy(**places, s=slip), slip.shape)
        )

    def whole(points: FloatArray, slip: FloatArray) -> FloatArray:
        mu = agree(comm, lambda: local(points, slip))
        # Zero, computed from other numbers, may come out below zero by their rounding.
        least = -_COEFFICIENT_ROUNDING * comm.allreduce(np.abs(mu).max(initial=0.0), op=MPI.MAX)
        agree(comm, lambda: _refuse_negative(mu, least, points, slip, key))
        return np.maximum(mu, 0.0)

    return FrictionLaw(
        whole,
        largest=float(expression.numpy()) if expression.is_constant else None,
        lipschitz=None if "s" in expression.names else 0.0,
    )


def _refuse_negative(
    mu: FloatArray, least: float, points: FloatArray, slip: FloatArray, key: str
) -> None:
    """Raise InputError, with the place, if a friction coefficient is below ``least``."""
    if not np.any(mu < least):
        return
    worst = int(np.argmin(mu))
    where = [f"{axis} = {place:.6g}" for axis, place in zip(AXES, points[worst], strict=False)]
    raise InputError(
        f"the friction coefficient must not be negative, it is {mu[worst]:g} at "
        f"{', '.join(where)}, s = {slip[worst]:.6g}",
        key,
    )


def _quoted(names: tuple[str, ...]) -> str:
    return ", ".join(repr(name) for name in names)
