"""The discrete problem of a study file, before the first solve."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from contact_locking.arrays import AXES, BoolArray, FloatArray, IndexArray
from contact_locking.contact.contact import Contact
from contact_locking.contact.friction import Mollifier
from contact_locking.contact.surface import PRESCRIBED
from contact_locking.errors import InputError
from contact_locking.expressions import parse
from contact_locking.fem.spaces import Element, element_of
from contact_locking.fields.between_steps import unseen_peaks
from contact_locking.fields.clock import Clock
from contact_locking.fields.sampling import Entities, features
from contact_locking.fields.values import PresentValue
from contact_locking.mesh import domain as domains
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.file.xdmf_grids import is_xdmf
from contact_locking.mesh.groups import groups
from contact_locking.mesh.half_section import half_section, require_surface
from contact_locking.mesh.named_parts import Place, Test, with_parts
from contact_locking.penalty_method.scope import require_served
from contact_locking.problem.discrete_problem import Body, DiscreteProblem
from contact_locking.study.loads import build_loads, springs_of
from contact_locking.study.material import material_in_cells, material_warnings
from contact_locking.study.probe_points import locate
from contact_locking.study_file import require_parameters
from contact_locking.study_file.parameters import HOLD_ALONG, Parameters
from contact_locking.study_file.parameters.boundary import LoadParameters
from contact_locking.study_file.parameters.mesh import BoundaryPart, MeshParameters
from contact_locking.supports.conditions import ComponentCondition, constrain
from contact_locking.supports.support import Support
from contact_locking.values.concept import BodyKind, dotted, require_fitting
from contact_locking.values.value import Value


class StudyProblem(DiscreteProblem):
    """The discrete problem of a study file, whose data depend on the time of its clock.

    ``domain`` is the mesh and ``element`` the element of displacements.  A problem of steps is made
    for the first time.  The constructor is collective.  Raises InputError for data that do not fit
    the mesh or the element.
    """

    def __init__(self, parameters: Parameters, domain: Domain, element: Element) -> None:
        self.parameters = parameters
        told = [f"{domain.origin}: {warning}" for warning in domain.warnings]
        parameters.check_dimension(domain.dim)
        space = element.displacement_space(domain.mesh)
        _check_parts(domain, parameters)
        self.probes = locate(domain, parameters.output.probes)
        steps = parameters.steps
        times = (0.0,) if steps is None else steps.planned
        self.clock = clock = Clock(domain.mesh, times[0], times)
        material = material_in_cells(domain, parameters.material)
        conditions, supports, of_values = _held(domain, parameters.loads, clock)
        told += of_values
        constraints = constrain(domain, space, conditions, supports, [], clock)
        contacts = [_with_radius(domain, item) for item in parameters.contacts]
        self.loads = build_loads(domain, parameters.loads, element, clock)
        springs, of_springs = springs_of(domain, parameters.loads.springs)
        v = ufl.TestFunction(space)
        body = Body(
            domain=domain,
            element=element,
            space=space,
            constraints=constraints,
            loads=self.loads.work(v),
            springs=springs,
            displacements=[name for item in parameters.loads.displacements for name in item.on],
            supports=[name for item in parameters.loads.supports for name in item.on],
            **material,
        )
        penalty = parameters.penalty
        super().__init__(body, contacts, penalty.n, penalty.epsilon, clock)
        self.rigidity.require_held()
        told += material_warnings(body, clock) + of_springs
        for item in parameters.contacts:
            told += friction_warnings(domain, item)
        told += self.loads.warnings(self.material.stiffness)
        told += parameters.idle_friction()
        for key, value in parameters.timed():
            told += unseen_peaks(value, key, clock, domain.bounding_box)
        # Two contacts may have one section of friction.
        self.warnings = list(dict.fromkeys([*told, *self.warnings]))

    def advance(self, time: float) -> None:
        """Put the data that depend on the time to a time; collective.

        Raises InputError for a value that is not finite, and for a force that turns.
        """
        self.clock.set(time)
        self.material.advance()
        self.warnings += self.loads.advance()
        self.place()

    def facts(self) -> dict[str, Any]:
        """The facts that ``contact-locking check`` prints; collective."""
        dofmap = self.u.function_space.dofmap
        unknowns = int(dofmap.index_map.size_global * dofmap.index_map_bs)
        facts = {
            "dimension": self.domain.dim,
            "cells": self.domain.num_cells,
            "dofs": unknowns,
            "compact dofs": self.domain.compact_size(unknowns, self.element.degree),
            "elements": str(self.element),
            "regions": sorted(self.domain.cell_names),
            "boundary parts": sorted(self.domain.facet_names),
            "groups": groups(self.domain),
            "held by": {part.name: str(part) for part in self.held},
            "smallest eigenvalue of A": self.material.ellipticity,
        }
        if self.contacts:
            count = sum(len(contact.surface.nodes) for contact in self.contacts)
            facts["contact points"] = int(self.domain.comm.allreduce(count))
        return facts


def _with_radius(domain: Domain, contact: Contact) -> Contact:
    """A contact on a refined mesh, which keeps the default radius of R on the first mesh."""
    friction, radius = contact.friction, domain.smoothing_radii.get(contact.key)
    if friction is None or radius is None:
        return contact
    smoothing = Mollifier(radius=radius)
    if isinstance(friction.smoothing, Mollifier):
        smoothing = friction.smoothing.over(smoothing)
    friction = friction.model_copy(update={"smoothing": smoothing})
    return contact.model_copy(update={"friction": friction})


# A slip, as a share of the size of the body.
_SOME_SLIP = 1e-3


def friction_warnings(domain: Domain, contact: Contact) -> list[str]:
    """Features of the friction coefficient between the nodes; collective.  Raises for a pole."""
    mu = None if contact.friction is None else contact.friction.coefficient
    if mu is None or mu.expression is None:
        return []
    key = f"{contact.key}.friction.coefficient"
    facets = Entities.of(domain, domain.dim - 1, domain.facets(contact.on))
    # Friction may begin with the slip; from the size of the body on the slip is as good as endless.
    slips = [0.0, _SOME_SLIP * domain.extent, domain.extent]
    for slip in slips if "s" in mu.expression.names else slips[:1]:
        if found := features(facets, mu, key, "refine the mesh there", s=slip):
            return found
    return []


def check(
    parameters: Parameters,
    comm: MPI.Intracomm,
    checks: Iterable[Callable[[StudyProblem], None]] = (),
) -> dict[str, Any]:
    """The facts and warnings of the assembled problem, which ``checks`` may refuse; collective."""
    problem = assemble(parameters, comm)
    if parameters.solver.method == "penalty":
        require_served(problem)
    for check_problem in checks:
        check_problem(problem)
    problem.close()
    return {**problem.facts(), "warnings": problem.warnings}


def assemble(
    parameters: Parameters,
    comm: MPI.Intracomm,
    domain: Domain | None = None,
    element: Element | None = None,
) -> StudyProblem:
    """Make mesh, material, loads, conditions, contact and friction; collective.

    ``domain`` replaces the mesh of the study and ``element`` its element, if given.  Raises
    InputError for data that do not fit the mesh or the element.
    """
    require_parameters(parameters)
    domain = domain or mesh_of(parameters, comm)
    if parameters.mesh.axisymmetric:
        domain = half_section(domain)
    degree, boxes = parameters.discretisation.degree, not domain.kind.is_simplex
    element = element or element_of(degree, domain.axisymmetric, boxes)
    if element.kinematics is not domain.kinematics:
        raise InputError(
            "the given element has the kinematics of another body; take P1_REVOLUTION or "
            "P2_REVOLUTION for an axisymmetric body, and for no other",
            "mesh.axisymmetric",
        )
    return StudyProblem(parameters, domain, element)


def mesh_of(parameters: Parameters, comm: MPI.Intracomm) -> Domain:
    """The mesh of the study, which is the first mesh where meshes are adapted; collective."""
    domain = _given_mesh(parameters, comm)
    if parameters.mesh.axisymmetric:
        domain = half_section(domain)
    return with_placed_parts(domain, parameters.mesh)


def _given_mesh(parameters: Parameters, comm: MPI.Intracomm) -> Domain:
    """The mesh of a builder, or the mesh in a file; collective."""
    geometry = parameters.mesh.geometry
    if geometry is not None:
        return domains.from_geometry(geometry, comm, parameters.refined_names)
    assert parameters.mesh.file is not None
    path = Path(parameters.mesh.file)
    if not is_xdmf(path):
        return domains.from_file(path, comm, parameters.touching)
    # SciPy, which these meshes need, would take a tenth of the time of `check` for others.
    from contact_locking.mesh.xdmf_mesh import from_xdmf

    return from_xdmf(path, comm)


def _check_parts(domain: Domain, parameters: Parameters) -> None:
    """Raise InputError for unknown boundary parts, and where a condition holds Gamma_C across."""
    contacts = [domain.facets(part.on, f"{part.key}.on") for part in parameters.contacts]
    loads = parameters.loads
    surfaces = [(part.on, f"{part.key}.on") for part in parameters.contacts]
    for kind in ("tractions", "pressures", "forces", "springs"):
        items = enumerate(getattr(loads, kind))
        surfaces += [(item.on, f"loads.{kind}.{i}.on") for i, item in items]
    for on, key in surfaces:
        require_surface(domain, on, key)
    for part, facets in zip(parameters.contacts, contacts, strict=True):
        if part.against and set(part.on) == set(part.against):
            _require_bodies(domain, part.on, facets, f"{part.key}.against")
    for place, condition in parameters.loads.held():
        key = dotted("loads", *place, "on")
        facets = domain.facets(condition.on, key)
        both = np.intersect1d(facets, np.concatenate([facets[:0], *contacts]))
        normals, areas = domain.area_normals(both)
        values = condition.value if isinstance(condition.value, tuple) else [condition.value]
        is_held = [value is not None for value in values]
        if domain.comm.allreduce(np.sum(np.abs(normals) * is_held > PRESCRIBED * areas[:, None])):
            raise InputError(
                "Gamma_C and Gamma_D overlap: contact and a displacement across it share facets of "
                f"{', '.join(map(repr, condition.on))}; {HOLD_ALONG}",
                key,
            )


def _require_bodies(domain: Domain, on: tuple[str, ...], facets: IndexArray, key: str) -> None:
    """Raise InputError for parts of one body that are to touch each other; collective."""
    comm, name = domain.comm, ", ".join(on)
    if len(set().union(*comm.allgather(domain.parts[domain.owners(facets)].tolist()))) > 1:
        return
    owned = domain.mesh.topology.index_map(domain.dim - 1).size_local
    normals, _ = domain.area_normals(facets[facets < owned])
    across = np.linalg.eigh(comm.allreduce(normals.T @ normals))[1][:, -1]
    across *= np.sign(across[np.argmax(np.abs(across))])
    lips = [
        f"{on[0]}_{number}: {{on: [{name}], facing: {(np.round(way, 2) + 0.0).tolist()}}}"
        for number, way in enumerate((across, -across), start=1)
    ]
    raise InputError(
        f"{name} belongs to one body, so that it holds both lips of a cut, which need a name each: "
        f"mesh.parts: {{{', '.join(lips)}}} and contact: {{on: {on[0]}_1, against: {on[0]}_2}}",
        key,
    )


def _held(
    domain: Domain, loads: LoadParameters, clock: Clock
) -> tuple[list[ComponentCondition], list[Support], list[str]]:
    """The prescribed components, the supports, and warnings about them; collective.

    The warnings are about values that change sharply inside of a facet.  Raises InputError for a
    pole there.
    """
    warnings: list[str] = []

    def look_at(on: tuple[str, ...], value: Value, key: str) -> None:
        facets = Entities.of(domain, domain.dim - 1, domain.facets(on, key))
        advice, times = "refine the mesh there", clock.some_times
        warnings.extend(features(facets, value, key, advice, times=times))

    conditions, supports = [], []
    for i, condition in enumerate(loads.displacements):
        for j, value in enumerate(condition.value):
            if value is not None:
                key = f"loads.displacements.{i}.value.{j}"
                look_at(condition.on, value, key)
                field = PresentValue(domain.comm, value, key, clock)
                conditions.append(ComponentCondition(condition.on, j, field, key, value.is_timed))
    for i, support in enumerate(loads.supports):
        supports.append(support.model_copy(update={"at": f"loads.supports.{i}"}))
        look_at(support.on, support.value, f"loads.supports.{i}.value")
    return conditions, supports, warnings


# A point is on a plane, or in a box, up to this share of the size of the body.
_ROUNDING = 1e-6


def with_placed_parts(domain: Domain, given: MeshParameters) -> Domain:
    """The domain with ``mesh.parts``; collective.

    Raises InputError for a value that does not fit the mesh, and for a part without facets.
    """
    if not given.parts:
        return domain
    require_fitting(given, BodyKind(domain.dim), "mesh")
    rounding = _ROUNDING * float(np.ptp(domain.bounding_box, axis=0).max())
    places = {
        name: Place(_tests(part, domain.dim, rounding), part.on, part.facing)
        for name, part in given.parts.items()
    }
    return with_parts(domain, places, "mesh.parts")


def _tests(part: BoundaryPart, dim: int, rounding: float) -> list[Test]:
    tests: list[Test] = []
    if part.plane is not None:
        point, normal = np.array(part.plane.point), np.array(part.plane.normal)
        unit = normal / np.linalg.norm(normal)
        tests.append(lambda x: np.abs(unit @ x - unit @ point) <= rounding)
    if part.box is not None:
        low, high = np.array(part.box)[:, :, None]
        tests.append(lambda x: np.all((x >= low - rounding) & (x <= high + rounding), axis=0))
    if part.expression is not None:
        condition = parse(part.expression, AXES[:dim], condition=True)

        def holds(x: FloatArray) -> BoolArray:
            values = condition.numpy(**dict(zip(AXES, x, strict=False)))
            return np.broadcast_to(np.asarray(values) > 0.0, x.shape[1:])

        tests.append(holds)
    return tests
