"""The derivatives that scripts and study files ask for, through the steps of a process as well."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from contact_locking.errors import InputError, NoDerivatives
from contact_locking.inverse.derivatives import (
    Derivatives,
    Frozen,
    Number,
    Table,
    entries,
    field,
    number_of,
    refresh,
    width,
)
from contact_locking.inverse.equations import Equations, share_at_change
from contact_locking.inverse.linearisation import Change, penalised_iterate
from contact_locking.inverse.quantities import quantity_of
from contact_locking.parallel import maximum
from contact_locking.process.problem_solver import ProblemSolver, linear_solver
from contact_locking.results.contact_points import OPEN
from contact_locking.results.derived import ContactFields
from contact_locking.results.quantities import look_up
from contact_locking.results.solution import Solution
from contact_locking.running.assembly import StudyProblem, assemble
from contact_locking.running.solving import SolvableStudy, settings_of, solve_assembled
from contact_locking.solver.ksp import UserOptions
from contact_locking.solver.monitor import Monitor
from contact_locking.solver.settings import Settings
from contact_locking.solver.task import Outcome, Task
from contact_locking.study_file.dump import plain
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.reading import assign, from_mapping

# These sections have no number that the equations depend on smoothly.
_NOT_SMOOTH = (
    *("mesh", "discretisation", "solver", "steps", "adapt", "certificate", "output", "study"),
    *("sensitivities", "fit", "title"),
)


def number_at(parameters: Parameters, key: str, asked: str = "sensitivities.to") -> float:
    """The number at a dotted key, which the section ``asked`` names.

    Raises InputError for a key without a derivative.
    """
    section = key.partition(".")[0]
    if section in _NOT_SMOOTH:
        why = f"the equations do not depend smoothly on numbers of the section {section}"
        raise InputError(f"{key}: {why}, so that there is no derivative with respect to it", asked)
    value: Any = plain(parameters)
    for word in key.split("."):
        if isinstance(value, dict) and word in value:
            value = value[word]
        elif isinstance(value, list) and word.isdecimal() and int(word) < len(value):
            value = value[int(word)]
        else:
            named = key in (parameters.parameters or {})
            meant = f" (did you mean 'parameters.{key}'?)" if named else ""
            raise InputError(f"{key} is not given in the file{meant}", asked)
    if isinstance(value, str):
        raise InputError(
            f"{key} is {value!r}, and no number: give its numbers names in the section parameters, "
            "as parameters: {mu0: 0.3}, and use parameters.mu0",
            asked,
        )
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{key} is no number: there is no derivative with respect to it", asked)
    if not math.isfinite(value):
        raise InputError(f"{key} is infinite: there is no derivative with respect to it", asked)
    return float(value)


def with_number(parameters: Parameters, key: str, value: float) -> Parameters:
    """The same study with another number at a dotted key, and without derivatives of its own.

    Raises InputError for a number that the key does not take.
    """
    try:
        return with_values(parameters, {key: value})
    except InputError as error:
        raise InputError(
            f"{key} has a bound at its value, beyond which a derivative needs to look",
            "sensitivities.to",
        ) from error


def with_values(parameters: Parameters, values: Mapping[str, Any]) -> Parameters:
    """One solve with other values at dotted keys: without derivatives, a fit and a study.

    Raises InputError for values that the keys do not take, and KeyError for an unknown place.
    """
    data = plain(parameters)
    for section in ("sensitivities", "fit", "study"):
        data.pop(section, None)
    for key, value in values.items():
        assign(data, key, value)
    return from_mapping(data)


# A family of points with more than this share near a change is told of.
_MANY = 0.02
# The width of a central difference of solves, relative to the number.
_CHECK = 1e-3


def deriving(solver: ProblemSolver) -> Settings:
    """The settings for derivatives, which take a factorisation where the body is small."""
    settings = solver.settings
    if linear_solver(solver.problem, "auto") == "direct" and settings.linear != "direct":
        # The options are those of an iterative solver.
        return settings.model_copy(update={"linear": "direct", "petsc": UserOptions({})})
    return settings


def require_derivatives(solver: ProblemSolver, names: Sequence[str] = ()) -> None:
    """Raise InputError for a problem or quantities without derivatives; needs no solve."""
    if deriving(solver).linear != "direct":
        raise NoDerivatives(
            "derivatives need a factorisation, for which auto considers this body too large; "
            "set solver.linear: direct",
            "solver.linear",
        )
    for name in names:
        quantity_of(name, solver.problem.domain, solver.system)


class LazyDerivatives:
    """The derivatives of the solution of a report, until :meth:`close`; collective."""

    def __init__(self, solver: ProblemSolver, report: Outcome) -> None:
        self._solver, self._report = solver, report
        self._made: Derivatives | None = None
        self._is_closed = False

    def derivative(self, quantity: str, of: Any) -> Any:
        """As :meth:`contact_locking.results.solution.Solution.derivative`."""
        match of:
            case fem.Constant():
                rates = np.array([self.made.by(quantity, entry) for entry in entries(of)])
                return rates.reshape(np.shape(of.value)) if np.ndim(of.value) else float(rates[0])
            case fem.Function():
                return field(self.made, quantity, of)
            case Number():
                return self.made.by(quantity, number_of(of))
        raise InputError(
            "derivatives are with respect to a constant or function of DOLFINx or a Number, not "
            f"{type(of).__name__}",
            "of",
        )

    @property
    def made(self) -> Derivatives:
        """The derivatives themselves.  Raises InputError for a solution that has none."""
        if self._is_closed:
            raise InputError(
                "the problem has been solved again, or closed, since this solution: ask for its "
                "derivatives before"
            )
        require_derivatives(self._solver)
        problem, system, report = self._solver.problem, self._solver.system, self._report
        for contact in problem.contacts:
            frame = contact.surface.frame
            if frame is not None and frame.displacement is not None:
                raise NoDerivatives(
                    "derivatives do not see how the bodies that touch turn their normals as they "
                    "deform; use pair: once",
                    f"{contact.key}.pair",
                )
        if not report.converged:
            raise InputError("a solve that has not converged has no derivatives")
        if self._made is None:
            # Data that have changed since are told from the equations, which they change.
            refresh(problem, system)
            target, settings = self._solver.target, deriving(self._solver)
            iterate = report.last
            if iterate is None and not target.penalty.is_soft:
                raise InputError(
                    "a solution that was read from a checkpoint has no last iterate, by which it "
                    "would be differentiated: solve it anew"
                )
            if iterate is None:
                iterate = penalised_iterate(system, target, settings.tolerance)
            frozen = Frozen(problem, system, lambda: self._solver.target, iterate)
            self._made = Derivatives(frozen, Task(system, target, settings))
        return self._made

    def close(self) -> None:
        """Destroy the PETSc objects."""
        self._is_closed = True
        if self._made is not None:
            self._made.destroy()
            self._made = None

    def __del__(self, is_finalized: Callable[[], bool] = PETSc.Sys.isFinalized) -> None:
        # The garbage collector clears the contexts of PETSc's objects before PETSc destroys these.
        if self._solver.problem.domain.comm.size == 1 and not is_finalized():
            self.close()


def require_known(problem: StudyProblem) -> None:
    """Raise InputError, without a solve, for what sensitivities or a fit cannot ask; collective."""
    parameters = problem.parameters
    solver = ProblemSolver(problem, settings_of(parameters))
    if (section := parameters.sensitivities) is not None:
        for name in section.to:
            number_at(parameters, name)
        require_derivatives(solver, section.of)
    if parameters.fit is not None:
        try:
            require_derivatives(solver, tuple(parameters.fit.quantities.values()))
        except NoDerivatives:
            return  # the fit takes differences
        except InputError as error:
            raise InputError(str(error), "fit.quantities") from error


class StudyNumber:
    """A number of a study file, with the study at two values around it; collective.

    The two problems are made at the first use, and remember what friction remembers at their value.
    Raises InputError for a key without a derivative.
    """

    def __init__(self, problem: StudyProblem, name: str) -> None:
        self.name = name
        self.value = number_at(problem.parameters, name)
        step = width(self, problem.domain.extent)
        self._sides: list[tuple[float, StudyProblem, ProblemSolver]] = []
        for value in (self.value + step, self.value - step):
            parameters = with_number(problem.parameters, name, value)
            made = StudyProblem(parameters, problem.domain, problem.element)
            made.advance(problem.clock.now)
            self._sides.append((value, made, ProblemSolver(made, settings_of(parameters))))
            made.set_memory(made.at_rest())

    def advance(self, time: float) -> None:
        """Put the data of both problems to a time."""
        for _, problem, _ in self._sides:
            problem.advance(time)

    @contextmanager
    def equations_at(self, value: float, frozen: Frozen) -> Iterator[Equations]:
        """A context with the equations for one of the two values."""
        (solver,) = (solver for side, _, solver in self._sides if side == value)
        solver.system.assemble_loads()
        with closing(Equations(solver.system, solver.target, frozen.iterate)) as equations:
            yield equations

    def remember(self, contacts: Sequence[ContactFields], change: Change, frozen: Frozen) -> None:
        """End a step, in which the iterate changes by ``change`` with this number."""
        for value, problem, solver in self._sides:
            system, step = solver.system, value - self.value
            owned = len(system.load)
            system.u.x.array[:] = system.constraints.free_part(frozen.iterate.displacement)
            system.u.x.array[:owned] += step * change.displacement[:owned]
            system.constraints.apply(system.u)
            system.tools.travels = tuple(
                np.add(frozen.iterate.travels, step * change.displacement[owned:])
            )
            problem.set_memory(
                [
                    contact.state_after(problem.u, fields.state != OPEN, fields.holds)
                    for contact, fields in zip(problem.contacts, contacts, strict=True)
                ]
            )

    def close(self) -> None:
        """Destroy the PETSc objects."""
        for _, problem, _ in self._sides:
            problem.close()


class Sensitivities:
    """The derivatives of a study, step by step; collective.

    Made before the first solve.  Raises InputError for quantities and numbers without
    a derivative, and for a problem without derivatives.
    """

    def __init__(self, study: SolvableStudy) -> None:
        section, solver = study.parameters.sensitivities, study.solver
        assert section is not None
        require_derivatives(solver, section.of)
        self._section, self._solver, self._monitor = section, solver, solver.monitor
        self._clock = study.problem.clock
        self._numbers = [StudyNumber(study.problem, name) for name in section.to]
        self._shares: dict[str, float] = {}

    def after(self, solution: Solution, report: Outcome) -> Solution:
        """The solution with the entries of its summary.

        The shares near a change are the largest of the steps so far, as friction remembers each.
        """
        if not solution.converged:
            return solution
        steps, time = solution.parameters.steps, self._clock.now
        if steps is None:
            self._monitor.message("computing derivatives")
        lazy = self._solver.derivatives(report)
        assert isinstance(lazy, LazyDerivatives)
        derivatives, numbers = lazy.made, self._numbers
        for kind, share in share_at_change(derivatives.linear.equations).items():
            self._shares[kind] = max(share, self._shares.get(kind, 0.0))
        if steps is None:
            table = derivatives.table(self._section.of, numbers)
        else:
            for number in numbers:
                number.advance(time)
            table, changes = derivatives.forward(self._section.of, numbers)
            for number, change in zip(numbers, changes, strict=True):
                number.remember(solution.contacts, change, derivatives.frozen)
        summary = entry(table, self._shares)
        if self._section.check and (steps is None or time == steps.planned[-1]):
            self._check(summary["sensitivities"], solution)
        return solution.with_entries(**summary)

    def _check(self, entries: dict[str, Any], solution: Solution) -> None:
        """Add to each derivative the difference of two solves; collective."""
        section, options = self._section, self._solver.settings.petsc

        def values(key: str, value: float) -> list[float] | None:
            changed = with_number(solution.parameters, key, value)
            changed = changed.model_copy(update={"sensitivities": None})
            problem = assemble(changed, solution.domain.comm, solution.domain, solution.element)
            other = solve_assembled(problem, Monitor(), options)
            return [value_of(name, other) for name in section.of] if other.converged else None

        for key in section.to:
            self._monitor.message(f"solving twice around {key}, to check its derivatives")
            at = number_at(solution.parameters, key)
            step = _CHECK * (abs(at) or solution.domain.extent)
            above, below = (values(key, at + side) for side in (step, -step))
            for place, name in enumerate(section.of):
                rate = None
                if above is not None and below is not None:
                    rate = (above[place] - below[place]) / (2.0 * step)
                entries[name][key]["checked"] = rate

    def close(self) -> None:
        """Destroy the PETSc objects."""
        for number in self._numbers:
            number.close()


def entry(table: Table, shares: dict[str, float]) -> dict[str, Any]:
    """The entries of summary.json about derivatives, with the shares of points near a change."""
    elasticities, entries = table.elasticities, dict[str, dict[str, Any]]()
    for row, quantity in enumerate(table.quantities):
        entries[quantity] = {}
        for column, name in enumerate(table.parameters):
            number = {"derivative": float(table.derivatives[row, column])}
            if table.are_nothing[row]:
                reason = f"{quantity} is zero, so that its change in per cent is undefined"
                entries[quantity][name] = number | {"elasticity": None, "reason": reason}
            else:
                entries[quantity][name] = number | {"elasticity": float(elasticities[row, column])}
    return {"sensitivities": entries, "share_at_change": {**shares, "in_words": in_words(shares)}}


def in_words(shares: dict[str, float]) -> str:
    """Whether the derivatives are to be trusted."""
    near = {name: share for name, share in shares.items() if share > 0.0}
    if not near:
        return "no point is near a change of its state: the derivatives hold on both sides"
    in_sets = ", ".join(f"{100.0 * share:.2g} % of {name}" for name, share in near.items())
    count = "few" if max(near.values()) <= _MANY else "many"
    return (
        f"{count} points are near a change of their state ({in_sets}): there derivatives differ "
        "from one side to the other; sensitivities.check compares with solves"
    )


def value_of(name: str, solution: Solution) -> float:
    """The value of a quantity that has a derivative, by the summary of a solution; collective."""
    if name == "pressure_max":
        comm = solution.domain.comm
        return max(maximum(comm, fields.pressure) for fields in solution.contacts)
    value: Any = solution.summary
    # Names of boundary parts may have dots.
    kind, _, place = name.partition(".")
    name_of_part, _, axis = place.rpartition(".")
    if kind == "reactions":
        return float(value[kind][name_of_part][int(axis)])
    return float(look_up(value, name))


def in_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """The table of derivatives, the numbers that matter most first; none without derivatives."""
    rows: list[tuple[str, ...]] = []
    for quantity, each in summary.get("sensitivities", {}).items():
        by_size = sorted(each.items(), key=lambda pair: -abs(pair[1]["elasticity"] or 0.0))
        for key, entry in by_size:
            elasticity = entry["elasticity"]
            none = str(entry.get("reason", ""))
            share = none if elasticity is None else f"{elasticity:+.3g} % for 1 %"
            checked = entry.get("checked")
            check = "" if checked is None else f"by solves {checked:.4g}"
            rows.append((f"d {quantity}/d {key}", f"{entry['derivative']:.4g}", share, check))
    return rows
