"""A solved state as the certificate looks at it, with what several of its parts need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from contact_locking import _compat
from contact_locking.laws.elasticity import strain
from contact_locking.problem import compiled, forms
from contact_locking.problem.assembly import Problem
from contact_locking.problem.system import PenalisedSystem
from contact_locking.results.derived import BodyFields, ContactFields, integral, penalised
from contact_locking.solver import Settings, SolverReport
from contact_locking.solver.target import Target

FloatArray = npt.NDArray[np.float64]


@dataclass
class SolvedState:
    """The problem, its solution with the stored multipliers, and what the solver says of it."""

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
        """The state that ``problem.u`` and the report's multipliers are; collective."""
        u, data, domain = problem.u, problem.data, problem.domain
        found = report.multipliers or penalised(domain, u, data)
        body = BodyFields(domain, u, data, problem.material, found.locking_stress)
        pairs = zip(data.contacts, found.contacts, strict=True)
        contacts = tuple(ContactFields(contact, u, forces) for contact, forces in pairs)
        return cls(problem, system, target, settings, report, body, contacts)

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
        """``sqrt(a(u, u)/(alpha |Omega|))``, never less than rounding in ``u`` makes of a strain.

        With alpha, and not with the largest eigenvalue of A, it does not shrink for nearly
        incompressible bodies, whose strains meet no more resistance than others.  Collective.
        """
        tolerance = self.settings.tolerance
        return self.target.mean_strain(self.energy, self.largest_displacement, tolerance)

    @cached_property
    def largest_displacement(self) -> float:
        """The largest component of u; collective."""
        local = float(np.max(np.abs(self.problem.u.x.array), initial=0.0))
        return float(self.problem.domain.comm.allreduce(local, op=MPI.MAX))

    @property
    def mean_stress(self) -> float:
        """``alpha`` times the mean strain."""
        return self.problem.material.ellipticity * self.mean_strain

    @cached_property
    def work(self) -> float:
        """What work is compared with: ``alpha |Omega| |eps|^2/2 + |int Z : eps|``; collective.

        The first is the elastic energy, but for rounding; the second is the share of locking, next
        to which the energy of a small strain can be nothing.
        """
        elastic = 0.5 * self.mean_stress * self.mean_strain * self.points.volume
        points = self.points
        products = np.einsum("kij,kij->k", points.locking_stress, points.strain)
        return elastic + abs(self.sum(points.weights * products))

    def share_of_work(self, value: float) -> float:
        """A work relative to :attr:`work`; a body at rest has none, and its share is the value."""
        return value / self.work if self.work > 0.0 else value

    def sum(self, values: FloatArray) -> float:
        """The sum over all ranks; collective."""
        return float(self.problem.domain.comm.allreduce(float(np.sum(values))))


class StrainPoints:
    """Values at the points of the strains in owned cells: tensors are (k, d, d), scalars (k,).

    ``weights`` (k,) are those of the rule of the locking limit, and ``volume`` is their sum.
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
        """The dofs of a scalar function, point by point."""
        return np.asarray(array[space.dofmap.list[: self._owned].reshape(-1)])

    def of(self, function: fem.Function) -> FloatArray:
        """The tensors of a tensor function."""
        dofs = function.function_space.dofmap.list[: self._owned].reshape(-1)
        return function.x.array.reshape(-1, self._dim, self._dim)[dofs]

    def interpolated(self, tensor: Expr) -> FloatArray:
        """The tensors of a UFL expression that is a strain or a stress in each cell."""
        function = fem.Function(self._space)
        function.interpolate(_compat.interpolation_expression(tensor, self._space))
        return self.of(function)
