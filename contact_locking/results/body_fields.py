"""Fields of the body of a solved displacement, and their part of the summary."""

from __future__ import annotations

from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import LARGEST, FloatArray
from contact_locking.fem import compiled
from contact_locking.fem.spaces import Element
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import maximum
from contact_locking.problem import forms
from contact_locking.problem.limits import LimitsOnMesh
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.multipliers import Multipliers

# A cell is locked if |eps| >= M (1 - 1e-6).
_LOCKED_MARGIN = 1e-6


class BodyFields:
    """Fields of the body in the space of strains, with the values at the points of the strains.

    ``locking_limit`` is M of the ball.  With other sets of strains it is the largest ``|eps|`` in K
    along the strain eps(u), so that ``|eps|`` over it is the utilisation of K: the largest of all
    sets.  Cells are locked that use up their limit.
    """

    def __init__(
        self, domain: Domain, system: PenalisedSystem, limits: LimitsOnMesh, found: Multipliers
    ) -> None:
        data, self._kept = system.data, system.kept
        self._element, self._dx = data.element, data.dx
        eps = data.strain(system.u)
        stress = data.elastic_stress(eps)
        norm = ufl.sqrt(ufl.inner(eps, eps))
        self.strain_norm = self._at_points(data.element, domain, norm, "strain_norm")
        self.elastic_stress = self._at_points(data.element, domain, stress, "elastic_stress")
        self.locking_stress, self.locking_parts = found.locking_stress, found.parts
        shares = [(item, item.utilisation(eps)) for item in data.limits]
        #: The utilisation of each set of strains but the ball.
        self.utilisations = [
            self._at_points(data.element, domain, share, item.name) for item, share in shares
        ]
        self.locking_limit = limits.limit
        if not data.only_ball:
            self.locking_limit = self._limit_along_strain(data, limits.limit)
        self.locked = fem.Function(limits.limit.function_space, name="locked")
        threshold = self.locking_limit.x.array * (1.0 - _LOCKED_MARGIN)
        self.locked.x.array[:] = self.strain_norm.x.array >= threshold
        at_peaks = data.element.at_peaks
        self._peaks = self.strain_norm
        if at_peaks is not data.element:
            self._peaks = self._at_points(at_peaks, domain, norm, "strain_norm")
        self._limit_at_peaks = limits.limit_at_peaks
        self._utilisations_at_peaks = [
            self._at_points(at_peaks, domain, share, item.name) for item, share in shares
        ]

    def _at_points(self, element: Element, domain: Domain, expr: Expr, name: str) -> fem.Function:
        space = element.strain_space(domain.mesh, expr.ufl_shape)
        function = fem.Function(space, name=name)
        at = "peaks" if element is not self._element else "points"
        function.interpolate(self._kept((expr, at), lambda: compiled.interpolation(expr, space)))
        function.x.scatter_forward()
        return function

    def share(self, domain: Domain, marks: FloatArray) -> float:
        """The share of the body where ``marks`` (k,) of the space of strains are 1; collective."""
        weights = self._kept("weights", lambda: self._weights(domain))
        # Both sums round alike, so that all or none of the body is exactly 1 or 0.
        marked, unmarked = domain.comm.allreduce(
            np.array([weights @ marks, weights @ (1.0 - marks)])
        )
        return float(marked / (marked + unmarked))

    def _weights(self, domain: Domain) -> FloatArray:
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

    def largest_overstrain(self, domain: Domain) -> float:
        """``max |eps|/M - 1`` over the points of the strains; collective."""
        return _largest(domain, self.strain_norm, self.locking_limit) - 1.0

    def peaks(self, domain: Domain) -> tuple[float, float]:
        """``max |eps|`` and ``max |eps|/M - 1`` over the whole of every cell; collective."""
        used = [_largest(domain, share) for share in self._utilisations_at_peaks]
        used.append(_largest(domain, self._peaks, self._limit_at_peaks))
        return _largest(domain, self._peaks), max(used) - 1.0


def body_summary(domain: Domain, system: PenalisedSystem, fields: BodyFields) -> dict[str, Any]:
    """The keys of summary.json about the body: energies, strains and sizes; collective."""
    data, dofmap = system.data, system.u.function_space.dofmap
    owned = fields.strain_norm.function_space.dofmap.index_map.size_local
    largest, overstrain = fields.peaks(domain)
    return {
        "discretisation": data.element.facts(),
        "dofs": int(dofmap.index_map.size_global * dofmap.index_map_bs),
        "cells": domain.num_cells,
        "ranks": domain.comm.size,
        "dolfinx": dolfinx.__version__,
        "compliance": system.compliance(),
        "elastic_energy": system.energy(),
        "strain_norm_max": maximum(domain.comm, fields.strain_norm.x.array[:owned]),
        "strain_norm_max_in_cells": largest,
        "overstrain_max": max(overstrain, 0.0),
        "locked_fraction": fields.share(domain, fields.locked.x.array),
        "strain_sets": [_about_set(domain, fields, share) for share in fields.utilisations],
    }


def _about_set(domain: Domain, fields: BodyFields, utilisation: fem.Function) -> dict[str, Any]:
    """The entry of summary.json about one set of strains beside the ball; collective."""
    used_up = (utilisation.x.array >= 1.0 - _LOCKED_MARGIN).astype(float)
    return {
        "name": utilisation.name,
        "utilisation_max": _largest(domain, utilisation),
        "locked_fraction": fields.share(domain, used_up),
    }


def _largest(domain: Domain, values: fem.Function, over: fem.Function | None = None) -> float:
    """The largest value at the points of the strains, as a multiple of ``over``; collective."""
    ratio = values.x.array if over is None else values.x.array / over.x.array
    return maximum(domain.comm, ratio)
