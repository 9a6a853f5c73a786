"""A contact problem on the user's own mesh, space and forms."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, get_args

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from ufl.core.expr import Expr

from contact_locking.contact.contact import Contact
from contact_locking.errors import InputError, require_kind
from contact_locking.fem.fields import Clock
from contact_locking.fem.spaces import Element, element_of
from contact_locking.laws.limits import PenaltyParameters
from contact_locking.laws.material import Elasticity
from contact_locking.mesh.data import NAMED
from contact_locking.mesh.domain import Domain, half_section
from contact_locking.mesh.parts import NamedFacets
from contact_locking.parallel import on_any_rank
from contact_locking.penalty_method import require_served
from contact_locking.problem.discrete_problem import Body, DiscreteProblem
from contact_locking.problem.elasticity import elasticity_of, split
from contact_locking.problem.forms import require_energy
from contact_locking.problem.points import Placed
from contact_locking.results.solution import Solution
from contact_locking.solver.settings import Settings
from contact_locking.supports.support import Displacement, Load, Spring, Support
from contact_locking.values.concept import BodyKind, Concept, require_fitting

if TYPE_CHECKING:
    from contact_locking.certificate.solved_state import Criterion, SolvedState
    from contact_locking.process.problem_solver import ProblemSolver
    from contact_locking.results.output import Extras
    from contact_locking.solver.monitor import Monitor
    from contact_locking.solver.task import Outcome

Condition: TypeAlias = fem.DirichletBC | Support | Displacement
T = TypeVar("T", bound=Concept)

# The section of a study file for each class of loads and supports.
_SECTIONS = {
    "BodyForce": "loads.body_force",
    "TotalForce": "loads.forces",
    "Traction": "loads.tractions",
    "Pressure": "loads.pressures",
    "Displacement": "loads.displacements",
    "Support": "loads.supports",
    "Spring": "loads.springs",
}
_KINDS = {"contacts": "a Contact", "springs": "a Spring", "loads": "a load, such as a Traction"}


class ContactProblem:
    """``a(u, v - u) + int G (|v_tau| - |u_tau|) >= L(v - u)``, ``G = mu(|u_tau|) |R sigma_nu(u)|``.

    The inequality holds for all v with ``eps(v) in K`` and ``v_nu <= gap``, and u satisfies both
    constraints.  For a finite ``n`` this is the penalised problem (25)/(26).

    - ``a``: a symmetric elliptic bilinear form of UFL, or an :class:`Elasticity`
    - ``L``: a linear form, added to ``loads``
    - ``bcs``: conditions of DOLFINx, :class:`Displacement`, :class:`Support`
    - ``limits``: sets of strains such as :class:`StrainBall`; K is their intersection
    - ``contacts``: :class:`Contact`
    - ``loads``: :class:`BodyForce`, :class:`Traction`, :class:`Pressure`, :class:`TotalForce`
    - ``springs``: :class:`Spring`
    - ``space``: the displacements, of degree 1 or 2; needed if neither ``a`` nor ``L`` is a form
    - ``tags``, ``names``: mesh tags of facets, and the names of their values for all of the above
    - ``n``, ``compliance``: penalties, a stress and a length over a stress (None: 1/n)
    - ``energy``: maps u to a convex and differentiable functional, which is added to the energy
    - ``axisymmetric``: the mesh is the half section (r, z) of a body of revolution
    - ``settings``, ``monitor``: of the solver, and what receives its progress

    Make the problem once; each solve reads the present values of the constants and functions in
    the data.  Constructor and methods are collective and raise InputError for unusable data.
    """

    def __init__(
        self,
        a: ufl.Form | Elasticity,
        L: ufl.Form | None = None,
        bcs: Sequence[Condition] = (),
        limits: Sequence[Any] = (),
        contacts: Sequence[Contact] = (),
        *,
        loads: Sequence[Load] = (),
        springs: Sequence[Spring] = (),
        space: fem.FunctionSpace | None = None,
        tags: dmesh.MeshTags | None = None,
        names: Mapping[str, int] | None = None,
        n: float = math.inf,
        compliance: float | None = None,
        energy: Callable[[fem.Function], Expr] | None = None,
        axisymmetric: bool = False,
        settings: Settings | None = None,
        monitor: Monitor | None = None,
    ) -> None:
        _check(a, L, axisymmetric, settings)
        _check_lists(bcs=bcs, limits=limits, contacts=contacts, loads=loads, springs=springs)
        space = _space_of(a, L, space)
        element = _element_of(space, axisymmetric)
        places = NamedFacets(space.mesh, tags, names)
        contacts = _placed("contacts", contacts, Contact, places)
        loads = _placed("loads", loads, get_args(Load), places)
        springs = _placed("springs", springs, Spring, places)
        supports = [condition for condition in bcs if isinstance(condition, Support)]
        displacements = [condition for condition in bcs if isinstance(condition, Displacement)]
        held: list[Support | Displacement] = [
            *_placed("supports", supports, Support, places),
            *_placed("displacements", displacements, Displacement, places),
        ]
        domain = places.domain()
        domain = half_section(domain, "axisymmetric") if axisymmetric else domain
        form, others = (None, None) if isinstance(a, Elasticity) else split(a)
        law = a if form is None else elasticity_of(form)
        body_kind = BodyKind(domain.dim, axisymmetric, law.plane == "stress")
        for concept in (*contacts, *held, *loads, *springs):
            require_fitting(concept, body_kind, concept.key)
        require_fitting(law, body_kind, "a")
        for number, limit in enumerate(limits):
            require_fitting(limit, body_kind, f"limits.{number}")
        if energy is not None:
            require_energy(energy, space)
        body = Body(
            domain,
            element,
            space,
            [Placed(law, "a")],
            limits=[Placed(limit, f"limits.{number}") for number, limit in enumerate(limits)],
            held=held,
            bcs=[condition for condition in bcs if isinstance(condition, fem.DirichletBC)],
            loads=loads,
            springs=springs,
            work=L,
            form=form,
            others=others,
            own_energy=energy,
        )
        self._discrete = DiscreteProblem(body, contacts, _penalty(n, compliance), Clock(space.mesh))
        for contact in self._discrete.contacts:
            contact.require_friction()
        self._settings, self._monitor = settings or Settings(), monitor
        if self._settings.method == "penalty":
            require_served(self._discrete)
        self._is_closed = False

    @cached_property
    def solver(self) -> ProblemSolver:
        """The solver of the problem, for drivers such as :class:`Process`."""
        # Solvers and certificate are half of the package; stating a problem does not need them.
        from contact_locking.process.problem_solver import ProblemSolver

        return ProblemSolver(self._discrete, self._settings, self._monitor)

    @property
    def displacement(self) -> fem.Function:
        """The displacement of the last solve; each solution has its own copy."""
        return self._discrete.u

    @property
    def domain(self) -> Domain:
        """The mesh with its named boundary parts."""
        return self._discrete.domain

    def solve(
        self,
        after: Solution | None = None,
        start: Solution | None = None,
        certificate: bool = True,
        extras: Extras | None = None,
    ) -> Solution:
        """The solution for the present data.

        - ``after``: the solution of the previous step, whose slip friction remembers and from which
          the solver starts; without it the problem is static
        - ``start``: a solution from which only the solver starts
        - ``certificate``: whether to compute the certificate, which takes a few solves
        - ``extras``: optional parts of the certificate

        A solve that fails returns its last state with ``converged`` False and a ``reason``.
        """
        solver, report = self.solver, self.report(after, start)
        # Derivatives of a step need those of the memory that it began with.
        derivatives = solver.derivatives(report) if after is None else None
        solution = solver.solution(solver.state(report), None, extras, derivatives, certificate)
        return solution.with_warnings(*solver.unused_options())

    def report(self, after: Solution | None = None, start: Solution | None = None) -> Outcome:
        """The outcome of a solve for the present data; arguments as in :meth:`solve`."""
        require_kind(start, Solution | None, "a solution of this problem", "start")
        self.begin(after)
        previous = after or start
        return self.solver.solve(previous.state.saved if previous else None)

    def solution(self, state: SolvedState, criteria: Mapping[str, Criterion]) -> Solution:
        """The solution in a state of ``solver``, which must meet these ``criteria`` as well."""
        return self.solver.solution(state, criteria)

    def begin(self, after: Solution | None = None) -> None:
        """Update ``solver`` to the present data and to the slip that friction remembers."""
        require_kind(after, Solution | None, "a solution of this problem", "after")
        problem = self._discrete
        memories = problem.at_rest()
        if after is not None:
            sizes, others = ([len(m.slip) for m in x] for x in (memories, after.state.contacts))
            if on_any_rank(self.domain.comm, sizes != others):
                raise InputError("is a solution with other contacts or on another mesh", "after")
            memories = after.state.contacts
        problem.set_memory(memories)
        self.refresh()

    def refresh(self) -> None:
        """Update ``solver`` to the present data."""
        if self._is_closed:
            raise InputError("the problem is closed: solve before close(), or make a new problem")
        problem, system = self._discrete, self.solver.system
        problem.refresh()
        # The stress of an eigenstrain is a load.
        system.assemble_loads()
        # The linear programmes for rigid motions cannot handle NaN.
        if on_any_rank(self.domain.comm, not np.all(np.isfinite(system.load))):
            raise InputError("is not finite somewhere", "L" if problem.body.work else "loads")
        problem.rigidity.require_held()
        for contact in problem.contacts:
            contact.require_friction()
        system.clear()

    def close(self) -> None:
        """Destroy the PETSc objects, after the last solve."""
        self._is_closed = True
        if "solver" in vars(self):
            self.solver.close()
        self._discrete.close()


def _check(a: Any, L: Any, axisymmetric: bool, settings: Any) -> None:
    words = "a form, such as inner(sigma(u), eps(v))*dx, or an Elasticity"
    require_kind(a, ufl.Form | Elasticity, words, "a")
    if L is not None and not (isinstance(L, ufl.Form) and len(L.arguments()) == 1):
        raise InputError("must be a linear form, with a test function alone: inner(f, v)*dx", "L")
    if axisymmetric and not isinstance(a, Elasticity):
        raise InputError("must be an Elasticity for an axisymmetric body", "a")
    require_kind(settings, Settings | None, "Settings, as Settings(tolerance=1e-9)", "settings")


def _penalty(n: Any, compliance: Any) -> PenaltyParameters:
    try:
        return PenaltyParameters(n, compliance)
    except InputError as error:
        key = "n" if str(error.key).endswith(".n") else "compliance"
        raise InputError(str(error), key) from None


def _check_lists(**lists: Any) -> None:
    for key, items in lists.items():
        require_kind(items, Sequence, "a list", key)
    for limit in lists["limits"]:
        if not callable(getattr(limit, "on", None)):
            raise InputError(f"must be limits, such as StrainBall(0.02), not {limit!r}", "limits")


def _space_of(
    a: ufl.Form | Elasticity, L: ufl.Form | None, space: fem.FunctionSpace | None
) -> fem.FunctionSpace:
    """``space``, which must be on the mesh of the forms, or the space of a form's arguments."""
    forms = {key: form for key, form in (("a", a), ("L", L)) if isinstance(form, ufl.Form)}
    spaces = {key: form.arguments()[0].ufl_function_space() for key, form in forms.items()}
    if space is None and not spaces:
        message = "is missing, and so are forms that have it: give space, L, or a form for a"
        raise InputError(message, "space")
    for key, form_space in spaces.items():
        if space is not None and form_space.mesh is not space.mesh:
            raise InputError(f"must be on the mesh of {key}", "space")
    return space or next(iter(spaces.values()))


def _element_of(space: fem.FunctionSpace, axisymmetric: bool) -> Element:
    element, dim = space.element.basix_element, space.mesh.topology.dim
    degree = element.degree
    if space.dofmap.bs != dim or degree not in (1, 2) or element.discontinuous:
        raise InputError(
            f"must have {dim} continuous components of degree 1 or 2, as in "
            f'fem.functionspace(mesh, ("Lagrange", 1, ({dim},)))',
            "space",
        )
    kind = NAMED[space.mesh.topology.cell_name()]
    return element_of(degree, axisymmetric, boxes=not kind.is_simplex)


def _placed(name: str, concepts: Sequence[T], kind: Any, places: NamedFacets) -> list[T]:
    """The concepts of a list, each with its key and its named boundary parts; collective.

    Loads and supports get the keys of a study file, which has one list for each kind.
    """
    placed, counts = [], Counter[str]()
    for number, concept in enumerate(concepts):
        require_kind(concept, kind, _KINDS.get(name, name), f"{name}.{number}")
        section = _SECTIONS.get(type(concept).__name__, name)
        key = section if section == _SECTIONS["BodyForce"] else f"{section}.{counts[section]}"
        counts[section] += 1
        sides = {
            side: places.add(where, key if side == "on" else f"{key}.{side}")
            for side in ("on", "against")
            if (where := getattr(concept, side, None)) is not None
        }
        placed.append(concept.model_copy(update={**sides, "at": key}))
    return placed
