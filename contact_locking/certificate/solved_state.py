"""A solved state, with the quantities that several parts of the certificate need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from contact_locking import _compat
from contact_locking.arrays import FloatArray
from contact_locking.laws.elasticity import strain
from contact_locking.parallel import maximum
from contact_locking.problem import compiled, forms
from contact_locking.problem.assembly import Problem
from contact_locking.problem.system import PenalisedSystem
from contact_locking.results.derived import BodyFields, ContactFields, integral, penalised
from contact_locking.solver import Settings, SolverReport
from contact_locking.solver.target import Target


@dataclass
class SolvedState:
    """A problem with its solution, the stored multipliers and the report of the solver."""

    problem: Problem
    system: PenalisedSystem
    target: Target
    settings: Settings
    report: SolverReport
    body: BodyFields
    contacts: tuple[ContactFields, ...]

    @classmethod
    def of(
        cls,
        problem: Problem,
        system: PenalisedSystem,
        target: Target,
        settings: Settings,
        report: SolverReport,
    ) -> SolvedState:
        """The state with the displacement ``problem.u`` and the multipliers of the report.

        Without multipliers the stresses are those of the penalty laws.  Collective.
        """
        u, data, domain = problem.u, problem.data, problem.domain
        found = report.multipliers or penalised(domain, u, data)
        body = BodyFields(domain, u, data, problem.material, found.locking_stress)
        pairs = zip(data.contacts, found.contacts, strict=True)
        contacts = tuple(ContactFields(contact, u, forces) for contact, forces in pairs)
        return cls(problem, system, target, settings, report, body, contacts)

    @property
    def comm(self) -> MPI.Intracomm:
        return self.problem.domain.comm

    @property
    def dim(self) -> int:
        return self.problem.domain.dim

    @cached_property
    def points(self) -> StrainPoints:
        return StrainPoints(self)

    @cached_property
    def energy(self) -> float:
        """``a(u, u)/2``; collective."""
        u = self.problem.u
        return integral(self.problem.domain, 0.5 * forms.elastic_form(u, u, self.problem.data))

    @cached_property
    def mean_strain(self) -> float:
        """``sqrt(a(u, u)/(alpha |Omega|))``, at least the rounding in the strain; collective.

        With the largest eigenvalue of A in the place of alpha, the mean strain would vanish for
        nearly incompressible bodies.
        """
        tolerance = self.settings.tolerance
        return self.target.mean_strain(self.energy, self.largest_displacement, tolerance)

    @cached_property
    def largest_displacement(self) -> float:
        """The largest component of u; collective."""
        return maximum(self.comm, np.abs(self.problem.u.x.array))

    @property
    def mean_stress(self) -> float:
        """``alpha`` times the mean strain."""
        return self.problem.material.ellipticity * self.mean_strain

    @cached_property
    def work(self) -> float:
        """The work of the state: ``alpha |Omega| |eps|^2/2 + |int Z : eps|``; collective.

        With the mean strain |eps| the first term is the elastic energy, except for rounding.  The
        second term is the work of the locking stress, which can exceed the elastic energy by far.
        """
        elastic = 0.5 * self.mean_stress * self.mean_strain * self.points.volume
        points = self.points
        products = np.einsum("kij,kij->k", points.locking_stress, points.strain)
        return elastic + abs(self.sum(points.weights * products))

    def share_of_work(self, value: float) -> float:
        """A value relative to :attr:`work`; the value itself for a body at rest."""
        return value / self.work if self.work > 0.0 else value

    def sum(self, values: FloatArray) -> float:
        """The sum over all ranks; collective."""
        return float(self.comm.allreduce(float(np.sum(values))))


class StrainPoints:
    """Values at the points of the strains in owned cells: tensors are (k, d, d), scalars (k,).

    ``weights`` (k,) are the weights of the locking rule, and ``volume`` is the volume of the body.
    """

    def __init__(self, state: SolvedState) -> None:
        domain, element = state.problem.domain, state.problem.element
        mesh, dim = domain.mesh, domain.dim
        self._owned = mesh.topology.index_map(dim).size_local
        self._dim = dim
        self._space = element.strain_space(mesh, (dim, dim))
        scalar = element.strain_space(mesh)
        ones = compiled.form(ufl.TestFunction(scalar) * state.problem.data.locking_dx)
        self.weights = self.scalars(fem.assemble_vector(ones).array, scalar)
        self.volume = float(domain.comm.allreduce(float(self.weights.sum())))
        self.limit = self.scalars(state.problem.material.limit.x.array, scalar)
        self.locking_stress = self.of(state.body.locking_stress)
        self.strain = self.interpolated(strain(state.problem.u))

    def scalars(self, array: FloatArray, space: fem.FunctionSpace) -> FloatArray:
        """The values of a scalar function at the points, from its dofs."""
        return np.asarray(array[space.dofmap.list[: self._owned].reshape(-1)])

    def of(self, function: fem.Function) -> FloatArray:
        """The values of a tensor function at the points."""
        dofs = function.function_space.dofmap.list[: self._owned].reshape(-1)
        return function.x.array.reshape(-1, self._dim, self._dim)[dofs]

    def interpolated(self, tensor: Expr) -> FloatArray:
        """The values of a UFL tensor at the points."""
        function = fem.Function(self._space)
        function.interpolate(_compat.interpolation_expression(tensor, self._space))
        return self.of(function)
