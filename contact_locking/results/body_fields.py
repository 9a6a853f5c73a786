"""Fields of the body of a solved displacement."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import LARGEST, FloatArray
from contact_locking.fem import compiled
from contact_locking.fem.spaces import Element
from contact_locking.parallel import maximum, minimum, peak
from contact_locking.problem import forms
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.multipliers import Multipliers

# A cell is locked if |eps| >= M (1 - 1e-6).
_LOCKED_MARGIN = 1e-6


def _norm(eps: Expr) -> Expr:
    return ufl.sqrt(ufl.inner(eps, eps))


def _angle(u: Expr) -> Expr:
    turn = ufl.skew(ufl.grad(u))
    return ufl.sqrt(0.5 * ufl.inner(turn, turn))


class BodyFields:
    """Fields of the body in the space of strains, with the values at the points of the strains.

    ``locking_limit`` is M of the ball.  With other sets of strains it is the largest ``|eps|`` in K
    along the strain eps(u), so that ``|eps|`` over it is the utilisation of K: the largest of all
    sets.  Cells are locked that use up their limit.  ``von_mises`` is None for a body in the plane
    whose stress across the plane is not known.
    """

    #: The names of all fields.
    FIELDS = (
        *("strain_norm", "locking_limit", "locked", "elastic_stress", "locking_stress"),
        *("von_mises", "locking_parts"),
    )

    def __init__(
        self, problem: DiscreteProblem, system: PenalisedSystem, found: Multipliers
    ) -> None:
        self.domain, self.system, limits = problem.domain, system, problem.limits
        self.displacement = system.u
        data, self._kept = system.data, system.kept
        self._element, self._dx = data.element, data.dx
        eps = data.strain(system.u)
        norm = functools.partial(_norm, eps)
        self.strain_norm = self._at_points(data.element, norm, "strain_norm")
        stress = functools.partial(data.elastic_stress, eps)
        self.elastic_stress = self._at_points(data.element, stress, "elastic_stress")
        self.locking_stress, self.locking_parts = found.locking_stress, found.parts
        shares = [(item, functools.partial(item.utilisation, eps)) for item in data.limits]
        #: The utilisation of each set of strains but the ball.
        self.utilisations = [
            self._at_points(data.element, share, item.name, number)
            for number, (item, share) in enumerate(shares)
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
            self._at_points(at_peaks, share, item.name, number)
            for number, (item, share) in enumerate(shares)
        ]
        self.von_mises = self._von_mises(problem)

    def _at_points(
        self, element: Element, made: Callable[[], Expr], name: str, number: int | None = None
    ) -> fem.Function:
        """The values of an expression, which is made once for each name and number."""

        def compile_it() -> tuple[fem.FunctionSpace, fem.Expression]:
            expr = made()
            space = element.shared_strain_space(self._kept, self.domain.mesh, expr.ufl_shape)
            return space, compiled.interpolation(expr, space)

        at = "peaks" if element is not self._element else "points"
        space, values = self._kept((name, number, at), compile_it)
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
        # Both sums round alike, so that all or none of the body is exactly 1 or 0.
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
        used = np.max([item.x.array for item in self.utilisations], axis=0)
        is_limited = np.max([item.inverse_limit.x.array for item in data.limits], axis=0) > 0.0
        along = np.where(is_limited, LARGEST, np.inf)
        where = used > 1.0 / LARGEST
        along[where] = self.strain_norm.x.array[where] / used[where]
        limit.x.array[:] = np.minimum(limit.x.array, along)
        return limit

    def _von_mises(self, problem: DiscreteProblem) -> fem.Function | None:
        """``sqrt(3/2) |dev sigma|`` of the whole stress, at the points of the strains; collective.

        Across the plane acts the elastic stress alone in plane strain, where the ball, whose
        multiplier is parallel to the strain, is the only set; and nothing acts in plane stress.
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
        """The entries of summary.json about the sets of strains beside the ball; collective."""
        return [
            {
                "name": item.name,
                "utilisation_max": self.largest(item),
                "locked_fraction": self.share((item.x.array >= 1.0 - _LOCKED_MARGIN).astype(float)),
            }
            for item in self.utilisations
        ]
