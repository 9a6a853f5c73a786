"""The result of a solve: the displacement, the derived fields, the state and the summary."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.results.adapted_meshes import AdaptedMesh
from contact_locking.results.contact_points import ContactPoints
from contact_locking.results.history import History

if TYPE_CHECKING:
    from dolfinx import fem

    from contact_locking.contact.nodal_contact import ContactState
    from contact_locking.fem.spaces import Element
    from contact_locking.mesh.domain import Domain
    from contact_locking.results.derived import ContactFields
    from contact_locking.results.probe_table import ProbeSample
    from contact_locking.solver.multipliers import Multipliers
    from contact_locking.solver.task import SavedState
    from contact_locking.study_file.parameters import Parameters


@dataclass(frozen=True)
class State:
    """Displacement, multipliers, travel of foundations, and the memory of friction.

    A solver may start from ``saved``; ``contacts`` are the memories of friction at each contact
    after the step that has ended with the solution.
    """

    saved: SavedState
    multipliers: Multipliers
    contacts: tuple[ContactState, ...]


class Differentiable(Protocol):
    """The derivatives of a solution, as long as its problem is not solved again."""

    def derivative(self, quantity: str, of: Any) -> Any:
        """As :meth:`Solution.derivative`."""


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The result of a solve: each rank has a share of the fields, rank 0 all contact points.

    The comments name the spaces of linear displacements; in general P1 stands for the space of
    displacements and P0 for the space of strains.  The fields on Gamma_C are functions on the whole
    mesh, zero off Gamma_C.  For a body without contact the tables of contact points and contact
    facets are empty.
    """

    domain: Domain
    element: Element
    displacement: fem.Function  # P1, vector
    strain_norm: fem.Function  # P0, |eps(u)|
    locking_limit: fem.Function  # P0, M; with other sets the largest |eps| along eps(u)
    locked: fem.Function  # P0, 1 where |eps| >= locking_limit (1 - 1e-6), else 0
    elastic_stress: fem.Function  # P0, (d, d): A eps(u)
    locking_stress: fem.Function  # P0, (d, d): Z
    von_mises: fem.Function | None  # P0, of both stresses; None if sigma_zz is not known
    locking_parts: tuple[fem.Function, ...]  # P0, the multiplier of each set of strains
    error_indicator: fem.Function | None  # P0, eta_K, the error in h by recovery
    elastic_error_indicator: fem.Function | None  # P0, the same for the elastic stress
    error_bound: fem.Function | None  # P0, the cells' shares in the guaranteed bound, if any
    contact_pressure: fem.Function  # P1, -sigma_nu >= 0
    smoothed_stress: fem.Function  # P1, R sigma_nu, without friction sigma_nu
    tangential_traction: fem.Function  # P1, vector, sigma_tau
    contact_state: fem.Function  # P1, OPEN, STICK or SLIP
    friction_bound: fem.Function  # P1, mu |R sigma_nu|
    contacts: tuple[ContactFields, ...]  # the nodal fields of each contact, on every rank
    contact_points: ContactPoints | None  # None on the ranks other than 0
    contact_facets: IntArray | None  # (m, d), corners as numbers of the points; None likewise
    state: State  # all that the next solve may take from this one
    summary: Mapping[str, Any]
    differentiable: Differentiable | None = None
    limits_of: str = "total"  # whether strain_norm is |eps(u)|, or "elastic" |eps(u) - eps_0|

    def derivative(self, quantity: str, of: Any) -> Any:
        """``dJ/dp``, J being a quantity of the summary such as "contact_force.1" or "compliance".

        ``of`` is p: a constant of DOLFINx, which gives a number or an array of its shape, a
        :class:`~contact_locking.sensitivity.parameters.Number`, which gives a number, or a function
        of DOLFINx, which gives a function of its space with the derivatives by its values.  J and p
        have units, and the derivative that of J over that of p.  Collective.  Raises InputError for
        a quantity without a derivative, for a step after another one, and if the problem has been
        solved again, or its data have changed, since the solve.  By the tangent of the last iterate
        (docs/solver.md, Derivatives).
        """
        if self.differentiable is None:
            raise InputError(
                "no derivatives are known of a step after another one, or of a solution that was "
                "read"
            )
        return self.differentiable.derivative(quantity, of)

    def telling(self, **entries: Any) -> Self:
        """The same solution, whose summary has further or other entries."""
        return replace(self, summary={**self.summary, **entries})

    @property
    def converged(self) -> bool:
        return bool(self.summary["converged"])


@dataclass(frozen=True, kw_only=True)
class StudySolution(Solution):
    """The solution of a problem from a study file, or of one of its steps."""

    parameters: Parameters
    meshes: tuple[AdaptedMesh, ...] = ()  # the adapted meshes up to this one, on rank 0
    time: float = 0.0  # the time of the step, 0 without steps
    history: History = field(default_factory=History)  # the steps up to this one, none without
    probes: tuple[ProbeSample, ...] = ()  # the probes of the steps up to this one, none without
    halved: tuple[str, ...] = ()  # which steps were halved, in words


def summary_text(summary: Mapping[str, Any]) -> str:
    """The summary as JSON.

    JSON has no infinity and no NaN.  The value is null in their place, and the mapping
    ``not_finite`` gives the number under its dotted key.
    """
    not_finite: dict[str, str] = {}
    plain = _jsonable(summary, "", not_finite)
    if not_finite:
        plain["not_finite"] = not_finite
    return json.dumps(plain, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _jsonable(value: Any, key: str, not_finite: dict[str, str]) -> Any:
    match value:
        case dict():
            return {
                str(name): _jsonable(item, f"{key}.{name}" if key else str(name), not_finite)
                for name, item in value.items()
            }
        case list() | tuple() | np.ndarray():
            return [_jsonable(item, f"{key}.{i}", not_finite) for i, item in enumerate(value)]
        case np.generic():
            return _jsonable(value.item(), key, not_finite)
        case float() if not math.isfinite(value):
            not_finite[key] = str(value)
            return None
    return value
