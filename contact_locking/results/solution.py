"""The result of a solve: displacement, derived fields, contact points, state and summary."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.findings import Finding
from contact_locking.problem.discrete_problem import distance
from contact_locking.results.contact_points import ContactPoints
from contact_locking.results.table import Table

if TYPE_CHECKING:
    from dolfinx import fem

    from contact_locking.contact.nodal_contact import ContactState
    from contact_locking.fem.spaces import Element
    from contact_locking.mesh.domain import Domain
    from contact_locking.problem.forms import ProblemData
    from contact_locking.results.derived import ContactFields
    from contact_locking.solver.task import Outcome, SavedState


_VERDICT = ("converged", "failure", "reason", "suggestion", "warnings")


@dataclass(frozen=True)
class State:
    """What the next solve needs of a solution.

    ``saved`` is a start for the solver, and ``contacts`` is what friction remembers at each contact
    after the step.
    """

    saved: SavedState
    contacts: tuple[ContactState, ...]


class Differentiable(Protocol):
    """The derivatives of a solution, valid until its problem is solved again."""

    def derivative(self, quantity: str, of: Any) -> Any:
        """As :meth:`Solution.derivative`."""

    def close(self) -> None:
        """Destroy the PETSc objects; collective."""


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The result of a solve; fields are distributed, rank 0 has all contact points.

    P1 stands for the space of displacements and P0 for that of strains, for every element.  Without
    contact the tables of Gamma_C are empty.

    Parameters
    ----------
    domain, element, data
        the mesh with its names, the element, and the forms of the problem
    displacement
        u: P1, vectors, a length
    strain_norm, locking_limit, locked
        ``|eps(u)|``; M, with other sets the largest ``|eps|`` along eps(u); and 1 where
        ``|eps| >= M (1 - 1e-6)``, else 0: P0, numbers
    elastic_stress, locking_stress, locking_parts, von_mises
        A eps(u) and Z, (d, d) each; the multipliers of the sets of strains; von Mises' stress of
        both, None if sigma_zz is not known: P0, stresses
    error_indicator, elastic_error_indicator
        eta_K, the error in h by recovery, and that of the elastic stress: P0, the root of an
        energy; None where they were not computed
    contact_pressure, smoothed_stress, tangential_traction, friction_bound, contact_state
        ``-sigma_nu >= 0``; R sigma_nu, without friction sigma_nu; the vector sigma_tau;
        ``mu |R sigma_nu|``: P1, stresses, zero off Gamma_C; OPEN, STICK or SLIP
    contacts
        the nodal fields of each contact, as arrays on every rank
    contact_points, contact_facets
        all points of contact, and the facets (m, d) by their numbers; None on ranks but 0
    state
        what the next solve needs of this one
    converged, failure, reason, suggestion, warnings
        whether solver and certificate accept it; code and words of a failure; findings
    certificate, report
        criteria, balances and errors, None if not computed; the outcome of the solver
    facts
        numbers by their keys of summary.json
    time, history, halved, probes
        of a step; probes have a row for each point on rank 0, and are None without points
    others, parameters, problem
        other solutions of a study, its parameters, and the fingerprint of its problem
    """

    domain: Domain
    element: Element
    displacement: fem.Function
    strain_norm: fem.Function
    locking_limit: fem.Function
    locked: fem.Function
    elastic_stress: fem.Function
    locking_stress: fem.Function
    von_mises: fem.Function | None
    locking_parts: tuple[fem.Function, ...]
    error_indicator: fem.Function | None
    elastic_error_indicator: fem.Function | None
    contact_pressure: fem.Function
    smoothed_stress: fem.Function
    tangential_traction: fem.Function
    contact_state: fem.Function
    friction_bound: fem.Function
    contacts: tuple[ContactFields, ...]
    contact_points: ContactPoints | None
    contact_facets: IntArray | None
    state: State
    facts: Mapping[str, Any]
    converged: bool = True
    failure: str = ""
    reason: str = ""
    suggestion: str = ""
    warnings: Sequence[Finding] = ()
    certificate: Any = None  # of the package certificate, which is made of results
    report: Outcome | None = None
    differentiable: Differentiable | None = None
    data: ProblemData | None = None
    time: float = 0.0
    history: Table = field(default_factory=Table)
    probes: Table | None = None
    halved: tuple[Finding, ...] = ()
    others: tuple[Solution, ...] = ()
    parameters: Any = None
    problem: str = ""

    def distance(self, other: Solution) -> dict[str, float]:
        """The distance to the displacement w of another solution on the same mesh.

        ``energy_norm`` is ``sqrt(a(u - w, u - w))``, ``relative`` is this over ``sqrt(a(u, u))``,
        and ``displacement_norm`` is the L2 norm of eps(u - w).  Collective.  Raises InputError for
        another mesh or degree.
        """
        if self.data is None:
            raise InputError("was read from files, which have no forms", "self")
        return distance(self.displacement, other.displacement, self.data)

    def derivative(self, quantity: str, of: Any) -> Any:
        """``dJ/dp`` of a quantity J of the summary, such as "contact_force.1" or "compliance".

        - ``of``: p, a constant of DOLFINx or a :class:`~contact_locking.inverse.derivatives.Number`
          (the derivative is a number, or an array of its shape), or a function of DOLFINx (the
          derivative by its values is a function of its space)

        The unit is that of J over that of p.  By the tangent of the last iterate (docs/solver.md,
        Derivatives).  Collective.  Raises InputError for a quantity without derivatives, for a step
        after another one, and if the problem was solved again or its data changed since the solve.
        """
        if self.differentiable is None:
            raise InputError(
                "steps after the first, and solutions read from files, have no derivatives"
            )
        return self.differentiable.derivative(quantity, of)

    def with_entries(self, **entries: Any) -> Self:
        """The solution with entries of its summary added or replaced."""
        verdict = {name: entries.pop(name) for name in _VERDICT if name in entries}
        return replace(self, **verdict, facts={**self.facts, **entries})

    def with_warnings(self, *findings: Finding) -> Self:
        """The solution with additional warnings."""
        return replace(self, warnings=[*self.warnings, *findings])

    @property
    def summary(self) -> dict[str, Any]:
        """The content of summary.json."""
        verdict: dict[str, Any] = {name: getattr(self, name) for name in _VERDICT}
        judged = {} if self.certificate is None else self.certificate.summary()
        warnings = verdict.pop("warnings")
        return {**verdict, **self.facts, "warnings": list(warnings), **judged}


#: The name by which scripts know the solution of a study file.
StudySolution = Solution


def summary_text(summary: Mapping[str, Any]) -> str:
    """The summary as JSON.

    JSON has no infinity and no NaN: such values are null, and the mapping ``not_finite`` has them
    by dotted key.
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
                str(name): _jsonable(entry, f"{key}.{name}" if key else str(name), not_finite)
                for name, entry in value.items()
            }
        case list() | tuple() | np.ndarray():
            return [_jsonable(entry, f"{key}.{i}", not_finite) for i, entry in enumerate(value)]
        case np.generic():
            return _jsonable(value.item(), key, not_finite)
        case float() if not math.isfinite(value):
            not_finite[key] = str(value)
            return None
    return value
