"""The discrete problem of a study file, before the first solve."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking import wings
from contact_locking.arrays import IndexArray
from contact_locking.contact.contact import Contact, Mollifier
from contact_locking.errors import InputError
from contact_locking.fem.fields import Clock
from contact_locking.fem.spaces import Element, element_of
from contact_locking.mesh import sources
from contact_locking.mesh.domain import Domain, half_section
from contact_locking.mesh.parts import groups, with_parts
from contact_locking.penalty_method import require_served
from contact_locking.problem.discrete_problem import Body, DiscreteProblem
from contact_locking.problem.points import Placed
from contact_locking.results.probes import locate
from contact_locking.study_file import require_parameters
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.problem import MaterialParameters, Region
from contact_locking.values.concept import BodyKind, dotted, require_fitting


class StudyProblem(DiscreteProblem):
    """The discrete problem of a study file, whose data depend on the time of its clock.

    ``domain`` is the mesh and ``element`` the element of displacements.  A problem of steps is made
    for the first time.  The constructor is collective.  Raises InputError for data that do not fit
    the mesh or the element.
    """

    def __init__(self, parameters: Parameters, domain: Domain, element: Element) -> None:
        self.parameters = parameters
        parameters.check_dimension(domain.dim)
        self.probes = locate(domain, parameters.output.probes)
        steps, loads = parameters.steps, parameters.loads
        clock = Clock(domain.mesh, () if steps is None else steps.planned)
        body = Body(
            domain,
            element,
            element.displacement_space(domain.mesh),
            held=loads.held,
            loads=loads.acting,
            springs=loads.of("springs"),
            **_material(domain, parameters.material),
        )
        contacts = [_with_radius(domain, contact) for contact in parameters.contacts]
        body.require_free(contacts)
        super().__init__(body, contacts, parameters.penalty, clock)
        self.rigidity.require_held()
        self.require_times(clock.planned)

    def advance(self, time: float) -> None:
        """Put the data that depend on the time to a time; collective.

        Raises InputError for a value that is not finite, and for a force that turns.
        """
        self.clock.set(time)
        self.refresh()

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
            "held by": {held.name: str(held) for held in self.held},
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


def _material(domain: Domain, material: MaterialParameters) -> dict[str, Any]:
    """The entries of a `Body` about its material; collective.

    Raises InputError for a region that the mesh does not have.
    """
    index_map = domain.mesh.topology.index_map(domain.dim)
    everywhere: IndexArray = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    law = material.elasticity.model_copy(update={"plane": material.plane})
    elasticity = [Placed(law, "material.elasticity", everywhere)]
    limited: list[tuple[str, Region]] = [("material", material)]
    # The limits of a region replace those of the material and of regions before it.
    owner, regions = np.zeros(len(everywhere), dtype=np.int32), []
    for name, region in material.regions.items():
        key = f"material.regions.{name}"
        regions.append(domain.cells(name, key))
        if region.elasticity is not None:
            elasticity.append(Placed(region.elasticity, f"{key}.elasticity", regions[-1]))
        if region.limits() is not None:
            owner[regions[-1]] = len(limited)
            limited.append((key, region))
    limits = []
    for number, (above, section) in enumerate(limited):
        inside = np.flatnonzero(owner == number).astype(np.int32)
        for place, limit in section.limits() or ():
            key = dotted(above, *place)
            limits.append(Placed(limit, key, inside, key if "locking_limit" in place else ""))
    eigenstrains = []
    for place, eigenstrain in material.eigenstrains:
        key, inside = dotted("material", *place), everywhere
        if eigenstrain.on is not None:
            parts = [domain.cells(name, f"{key}.on") for name in eigenstrain.on]
            inside = np.unique(np.concatenate(parts)).astype(np.int32)
            regions.append(inside)
        eigenstrains.append(Placed(eigenstrain, key, inside))
    return dict(elasticity=elasticity, eigenstrains=eigenstrains, limits=limits, regions=regions)


def check(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> dict[str, Any]:
    """The facts and findings of the assembled problem, without a solve; collective."""
    problem = assemble(parameters, comm)
    if parameters.solver.method == "penalty":
        require_served(problem)
    for check_problem in wings.CHECKS:
        check_problem(problem)
    problem.close()
    return {**problem.facts(), "findings": problem.findings}


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
            "the element has the kinematics of another body; use P1_REVOLUTION or "
            "P2_REVOLUTION for an axisymmetric body, and for no other",
            "mesh.axisymmetric",
        )
    return StudyProblem(parameters, domain, element)


def mesh_of(parameters: Parameters, comm: MPI.Intracomm) -> Domain:
    """The mesh of the study, which is the first mesh where meshes are adapted; collective.

    Raises InputError for parts of ``mesh.parts`` that do not fit the mesh or have no facets.
    """
    section = parameters.mesh
    if section.geometry is not None:
        domain = sources.from_geometry(section.geometry, comm, parameters.refined_names)
    else:
        domain = sources.from_file(Path(section.file or ""), comm, parameters.touching)
    if section.axisymmetric:
        domain = half_section(domain)
    require_fitting(section, BodyKind(domain.dim), "mesh")
    return with_parts(domain, section.parts, "mesh.parts") if section.parts else domain
