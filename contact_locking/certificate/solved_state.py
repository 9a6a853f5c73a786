"""A solved state with its scales, and strains at points, for all parts of the certificate."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from contact_locking.arrays import BoolArray, FloatArray, IndexArray
from contact_locking.fem import compiled
from contact_locking.mesh.domain import Domain, is_on_axis
from contact_locking.parallel import maximum
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.problem.strain_sets import NormSet, StrainSet
from contact_locking.problem.system import System
from contact_locking.results.derived import BodyFields, ContactFields
from contact_locking.solver.settings import Settings
from contact_locking.solver.task import Multipliers, Outcome, Target
from contact_locking.supports.conditions import Constraints


@dataclass(frozen=True)
class Criterion:
    """A relative value that must not exceed its limit; NaN counts as exceeding it.

    ``meaning`` completes "the ... is" in messages.
    """

    value: float
    limit: float
    meaning: str

    @property
    def holds(self) -> bool:
        return bool(self.value <= self.limit)

    def summary(self) -> dict[str, Any]:
        return {"value": self.value, "limit": self.limit, "holds": self.holds}


class SolvedState:
    """A problem with its solution ``problem.u``, its multipliers and the report of the solver.

    - ``body``, ``contacts``: the fields in the body and at each contact
    - ``mean_strain``, ``mean_stress``, ``work``: scales that values are judged by

    The constructor is collective.
    """

    def __init__(
        self,
        problem: DiscreteProblem,
        system: System,
        target: Target,
        settings: Settings,
        report: Outcome,
    ) -> None:
        self.problem, self.system = problem, system
        self.target, self.settings, self.report = target, settings, report
        self.multipliers = report.multipliers or Multipliers.zero(system)
        self.body = BodyFields(problem, system, self.multipliers)
        pairs = zip(problem.contacts, self.multipliers.contacts, strict=True)
        self.contacts = tuple(
            ContactFields(contact, problem.u, forces, problem.data.bounds)
            for contact, forces in pairs
        )

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
        return self.system.energy()

    @cached_property
    def mean_strain(self) -> float:
        """``sqrt(a(u, u)/(alpha |Omega|))``, at least the rounding in the strain; collective.

        With the largest eigenvalue of A instead of alpha it would vanish for nearly incompressible
        bodies.
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
        """``alpha |Omega| |eps|^2/2 + |int Z : eps|`` with the mean strain |eps|; collective.

        The first term is the elastic energy, except for rounding.  The second, the work of the
        locking stress, can be much larger.
        """
        elastic = 0.5 * self.mean_stress * self.mean_strain * self.points.volume
        points = self.points
        products = np.einsum("kij,kij->k", points.locking_stress, points.strain)
        return elastic + abs(self.sum(points.weights * products))

    @cached_property
    def _held(self) -> dict[int, BoolArray]:
        constraints, domain = self.problem.constraints, self.problem.domain
        # For two bodies the conditions of one side do not prescribe the jump.
        return {
            id(fields): are_held(domain, constraints, fields.surface.blocks, fields.normal)
            if not fields.surface.is_paired
            else ~fields.free
            for fields in self.contacts
        }

    def held(self, fields: ContactFields) -> BoolArray:
        """(k,) the nodes of a contact whose normal displacement is prescribed; collective."""
        return self._held[id(fields)]

    def weights(self, fields: ContactFields) -> FloatArray:
        """The weights (k,) of the nodes of a contact, zero at held nodes; collective."""
        return np.where(self.held(fields), 0.0, fields.surface.weights)

    def relative(self, distance: float) -> float | None:
        """A distance in the energy norm over that of u, None for a body at rest; collective."""
        size = (2.0 * self.energy) ** 0.5
        return float(distance / size) if size > 0.0 else None

    def share_of_work(self, value: float) -> float:
        """A value relative to :attr:`work`; the value itself for a body at rest."""
        return value / self.work if self.work > 0.0 else value

    def sum(self, values: FloatArray) -> float:
        """The sum over all ranks; collective."""
        return float(self.comm.allreduce(float(np.sum(values))))


class StrainPoints:
    """Values at the k points of the strains in owned cells.

    - ``weights``, ``limit``: of the locking rule, and M of the ball, (k,)
    - ``strain``, ``locking_stress``: eps(u) and Z, (k, m, m)
    - ``sets``: the sets of strains with their multipliers
    - ``volume``: of the body
    """

    def __init__(self, state: SolvedState) -> None:
        domain, element = state.problem.domain, state.problem.element
        mesh, dim = domain.mesh, domain.dim
        self._owned = mesh.topology.index_map(dim).size_local
        kept, dx = state.system.kept, state.problem.data.locking_dx
        self._kept = kept
        self._space = element.shared_strain_space(kept, mesh, element.strain_shape(mesh))
        scalar = self._scalar = element.shared_strain_space(kept, mesh)
        weights = kept(
            "locking weights",
            lambda: fem.assemble_vector(compiled.form(ufl.TestFunction(scalar) * dx)).array,
        )
        self.weights = weights[scalar.dofmap.list[: self._owned].reshape(-1)]
        self.volume = float(domain.comm.allreduce(float(self.weights.sum())))
        self.limit = self.of(state.problem.limits.limit)
        self.locking_stress = self.of(state.body.locking_stress)
        self._strained = kept("strained", lambda: fem.Function(state.problem.u.function_space))
        self._strain = element.strain(self._strained)
        pairs = zip(state.problem.data.sets, state.body.locking_parts, strict=True)
        self.sets = [self._set(law, y) for law, y in pairs]
        self.strain = self._measured(NormSet("strain", state.problem.data.inverse_limit))(
            state.problem.u
        )
        # The limit of the ball without the rounding of 1/(1/M).
        self.sets[0] = replace(self.sets[0], limit=self.limit)

    def by_cell(self, values: FloatArray) -> FloatArray:
        """Scalars (k,) at the points as (n, points of a cell), for the n owned cells."""
        return values.reshape(-1, self._scalar.dofmap.list.shape[1])

    def of(self, function: fem.Function) -> FloatArray:
        """The values of a tensor or of a scalar function at the points."""
        dofs = function.function_space.dofmap.list[: self._owned].reshape(-1)
        return function.x.array.reshape(-1, *function.ufl_shape)[dofs]

    def _set(self, law: StrainSet, multiplier: fem.Function) -> SetAtPoints:
        """A set with its multiplier; collective."""
        with np.errstate(divide="ignore"):
            limit = np.reciprocal(self.of(law.inverse_limit))
        return SetAtPoints(self._measured(law), limit, self.of(multiplier))

    def _measured(self, law: StrainSet) -> Callable[[fem.Function], FloatArray]:
        """The map from displacements w to ``L eps(w)`` at the points; collective."""

        def compiled_strain() -> tuple[fem.Function, fem.Expression]:
            expr = law.measured(self._strain)
            function = fem.Function(self._space if expr.ufl_shape else self._scalar)
            return function, compiled.interpolation(expr, function.function_space)

        function, expression = self._kept(("measured", law), compiled_strain)

        def measured(w: fem.Function) -> FloatArray:
            self._strained.x.array[:] = w.x.array
            function.interpolate(expression)
            return self.of(function)

        return measured


@dataclass(frozen=True, eq=False)
class SetAtPoints:
    """One set of strains at the points of the strains.

    - ``measured``: maps a displacement w to ``L eps(w)``: (k, m, m), or (k,) for a half space
    - ``limit``: M (k,)
    - ``multiplier``: y, in the shape of ``L eps``
    """

    measured: Callable[[fem.Function], FloatArray]
    limit: FloatArray
    multiplier: FloatArray

    @cached_property
    def size(self) -> FloatArray:
        """``|y|`` (k,), ``2n`` times the excess by the penalty law."""
        y = self.multiplier
        return np.asarray(np.linalg.norm(y, axis=(1, 2)) if y.ndim > 1 else np.abs(y))

    @cached_property
    def pulling(self) -> FloatArray:
        """The negative part (k,) of the multiplier of a half space, which should be zero."""
        y = self.multiplier
        return np.maximum(-y, 0.0) if y.ndim == 1 else np.zeros(len(y))

    @property
    def support(self) -> FloatArray:
        """``M |y|`` (k,): the largest work of y at a strain of the set, 0 where M is infinite."""
        return np.where(np.isfinite(self.limit), self.limit, 0.0) * self.size

    def reach(self, measured: FloatArray) -> FloatArray:
        """``|L eps|``, or ``L eps`` for a half space: (k,)."""
        return np.linalg.norm(measured, axis=(1, 2)) if measured.ndim > 1 else measured

    def excess(self, measured: FloatArray) -> FloatArray:
        """``[|L eps| - M]^+``, or ``[L eps - M]^+`` for a half space: (k,)."""
        return np.maximum(self.reach(measured) - self.limit, 0.0)

    def most_work(self, measured: FloatArray) -> FloatArray:
        """``|y| max(M, |L eps|)`` (k,): the work of a y that follows its law."""
        norm = self.reach(measured)
        # Without a limit M |y| must not be inf times 0.
        return self.size * np.maximum(np.where(np.isfinite(self.limit), self.limit, norm), norm)

    def work(self, measured: FloatArray) -> FloatArray:
        """``y : L eps`` (k,)."""
        if measured.ndim == 1:
            return self.multiplier * measured
        return np.einsum("kij,kij->k", self.multiplier, measured)


# A unit normal is in the span of prescribed directions if its distance from it is below this.
_ALONG = 1e-6


def reactions_by_part(
    domain: Domain, constraints: Constraints, reaction: FloatArray
) -> dict[str, FloatArray]:
    """The resultant (d,) on the body of the reactions of each boundary part; collective."""
    return {
        name: np.asarray(domain.comm.allreduce(share.reshape(-1, domain.dim).sum(axis=0)))
        for name, share in shares_by_part(domain, constraints, reaction).items()
    }


def shares_by_part(
    domain: Domain, constraints: Constraints, reaction: FloatArray
) -> dict[str, FloatArray]:
    """The share (k,) of each boundary part in the reactions; linear, node by node; collective.

    ``reaction`` (k,) are the reactions at the owned dofs of displacements, zero at free dofs.  The
    reaction of a node is a sum of forces along the components and directions that the parts
    prescribe there.  Parts that prescribe the same component of the same node have equal shares of
    its reaction, so that the resultants add up to the sum of all reactions.
    """
    dim, nodes = domain.dim, np.arange(len(reaction) // domain.dim, dtype=np.int32)
    rows = list(_rows(domain, constraints, nodes))
    nodes = np.unique(np.concatenate([nodes[:0], *(places for _, places, _ in rows)]))
    # The forces ``c_i m_i`` with ``sum c_i m_i = r`` and the least ``sum c_i^2``.
    gram = np.zeros((len(nodes), dim, dim))
    for _, places, m in rows:
        np.add.at(gram, np.searchsorted(nodes, places), np.einsum("ki,kj->kij", m, m))
    inverse = np.linalg.pinv(gram, rcond=1e-12, hermitian=True)
    solved = np.einsum("kij,kj->ki", inverse, reaction.reshape(-1, dim)[nodes])
    shares: dict[str, FloatArray] = {}
    for name, places, m in rows:
        share = shares.setdefault(name, np.zeros_like(reaction)).reshape(-1, dim)
        sizes = np.sum(m * solved[np.searchsorted(nodes, places)], axis=1)
        np.add.at(share, places, sizes[:, None] * m)
    return shares


def are_held(
    domain: Domain, constraints: Constraints, nodes: IndexArray, normals: FloatArray
) -> BoolArray:
    """(k,) whether the conditions prescribe the displacement of nodes along normals (k, d).

    ``nodes`` (k,) are owned blocks of the displacement space.  The directions are those prescribed
    on the boundary parts around a node, and x on the axis of revolution; the constraints of the
    solver are not used.  Collective.
    """
    dim, space = domain.dim, constraints.space
    spans = np.zeros((len(nodes), dim, dim))
    for _, places, directions in _rows(domain, constraints, nodes):
        np.add.at(spans, places, np.einsum("ki,kj->kij", directions, directions))
    if domain.axisymmetric:
        points = space.tabulate_dof_coordinates()[nodes]
        spans[is_on_axis(domain, points.T), 0, 0] += 1.0
    onto = np.einsum("kij,kjl->kil", np.linalg.pinv(spans, rcond=1e-12, hermitian=True), spans)
    free_share = normals - np.einsum("kij,kj->ki", onto, normals)
    return np.asarray(np.linalg.norm(free_share, axis=1) <= _ALONG)


def _rows(
    domain: Domain, constraints: Constraints, nodes: IndexArray
) -> Iterator[tuple[str, IndexArray, FloatArray]]:
    """For each part its name, the positions (m,) in ``nodes``, and the directions (m, d) held."""
    dim = domain.dim
    for placed in (*constraints.components, *constraints.oblique):
        for name in placed.on:
            facets = domain.facets((name,), placed.key)
            on_part = fem.locate_dofs_topological(constraints.space, dim - 1, facets)
            places, directions = placed.rows_at(nodes)
            is_on_part = np.isin(nodes[places], on_part)
            yield name, places[is_on_part], directions[is_on_part]
    for number, condition in enumerate(constraints.bcs):
        dofs = condition.dof_indices()[0]
        for axis, direction in enumerate(np.eye(dim)):
            places = np.flatnonzero(np.isin(dim * nodes + axis, dofs)).astype(np.int32)
            yield f"bcs.{number}", places, np.tile(direction, (len(places), 1))
