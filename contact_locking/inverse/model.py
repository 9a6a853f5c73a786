"""Measured curves, and the model of them: solves with their derivatives, each kept on disk.

A column of a CSV file is ``t``, a dotted key of the study file that varies from row to row, a
quantity that the file names, or a standard error: ``sigma`` of all quantities, or ``sigma_force``
of ``force``.  A file ``evaluations/FINGERPRINT.json`` has the quantities of all steps of a solve
and their derivatives: a fit that was killed finds them again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking import files, study_file
from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import ContactLockingError, InputError, NoDerivatives, with_key
from contact_locking.files import numbers_in, place_of, rows_of
from contact_locking.inverse.estimate import Variable
from contact_locking.inverse.sensitivities import number_at, value_of, with_values
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import on_root
from contact_locking.plain_text import count
from contact_locking.results.output import on_root_of
from contact_locking.running.cases import read_mapping
from contact_locking.running.solving import solve_steps
from contact_locking.study_file.parameters import Parameters, SensitivityParameters
from contact_locking.study_file.parameters.study import Curve, FitParameters

TIME, SIGMA = "t", "sigma"


@dataclass(frozen=True)
class Experiment:
    """The rows of a file: ``times`` (k,), or none, ``varied`` keys, and ``data`` of columns (k,).

    ``sigma`` has the standard errors of the columns that have some.  ``unused`` are columns that
    mean nothing.
    """

    key: str
    path: Path
    changes: Mapping[str, Any]
    times: FloatArray | None
    varied: Mapping[str, FloatArray]
    data: Mapping[str, FloatArray]
    sigma: Mapping[str, FloatArray]
    unused: tuple[str, ...]

    def __len__(self) -> int:
        return len(next(iter(self.data.values())))

    @property
    def count(self) -> int:
        """The measured numbers."""
        return sum(len(values) for values in self.data.values())

    def cases(self) -> list[Case]:
        """The solves of this experiment."""
        keys = list(self.varied)
        if not keys:
            return [Case(self, self.changes, np.arange(len(self)))]
        rows = np.array([self.varied[key] for key in keys])
        values, places = np.unique(rows, axis=1, return_inverse=True)
        return [
            Case(
                self,
                {**self.changes, **dict(zip(keys, map(float, column), strict=True))},
                np.flatnonzero(np.ravel(places) == number),
            )
            for number, column in enumerate(values.T)
        ]


@dataclass(frozen=True)
class Case:
    """A solve of an experiment: what it changes in the file, and the rows that it is for."""

    experiment: Experiment
    changes: Mapping[str, Any]
    rows: IntArray

    @property
    def times(self) -> FloatArray | None:
        return None if self.experiment.times is None else self.experiment.times[self.rows]


def read_experiments(parameters: Parameters) -> list[Experiment]:
    """The experiments of a study file.

    Raises InputError for a file without a fit, and for curves that cannot be used.
    """
    section = parameters.fit
    if section is None:
        raise InputError(
            "the file has no section fit; add one with data, quantities and parameters, as "
            "docs/guides/fit.md has it"
        )
    several = len(section.data) > 1
    experiments = [
        _read(curve, f"fit.data.{number}" if several else "fit.data", section)
        for number, curve in enumerate(section.data)
    ]
    for name in section.quantities:
        if not any(name in experiment.data for experiment in experiments):
            path = Path(section.data[0].file)
            with rows_of(path, "fit.data") as rows:
                header = [cell.strip() for cell in next(rows, [])]
                with_key("fit.quantities", partial(place_of, name, header, path))
    steps = parameters.steps
    for experiment in experiments:
        problem = ""
        if steps is None and experiment.times is not None:
            problem = (
                "has a column t, and the file has no steps: add a section such as "
                "steps: {to: 1, count: 20}, or name the column by the key that varies"
            )
        elif steps is None and not experiment.varied and len(experiment) > 1:
            problem = (
                "has several rows, and nothing that differs between them: neither a column t nor "
                "one with a key of the study file, as contact.gap"
            )
        elif steps is not None and experiment.times is None:
            problem = "has no column t, the times at which the steps are compared"
        elif steps is not None and experiment.times is not None:
            first, last = float(experiment.times.min()), float(experiment.times.max())
            if first < steps.start or last > steps.planned[-1] * (1.0 + 1e-9):
                problem = (
                    f"has times from {first:g} to {last:g}, and the steps go from {steps.start:g} "
                    f"to {steps.planned[-1]:g}; are the units the same?"
                )
        if problem:
            raise InputError(f"{experiment.path} {problem}", experiment.key)
    numbers, needed = sum(experiment.count for experiment in experiments), len(section.parameters)
    if numbers < needed:
        raise InputError(
            f"{count(needed, 'parameter')} to fit and {count(numbers, 'measured number')}: give "
            "more data, or fit fewer parameters",
            "fit.parameters",
        )
    return experiments


def _read(curve: Curve, key: str, section: FitParameters) -> Experiment:
    """The experiment of a file.  Raises InputError with the row of what is wrong."""
    path = Path(curve.file)
    with rows_of(path, key) as rows:
        header = [cell.strip() for cell in next(rows, [])]
        columns = [name for name in section.quantities if name in header]
        if not columns:
            first = next(iter(section.quantities))
            with_key("fit.quantities", partial(place_of, first, header, path))
        keys = [name for name in header if "." in name]
        errors = [name for name in (SIGMA, *(f"{SIGMA}_{c}" for c in columns)) if name in header]
        times = [TIME] if TIME in header else []
        names = [*times, *keys, *columns, *errors]
        places = {name: with_key(key, partial(place_of, name, header, path)) for name in names}
        numbers = with_key(key, partial(numbers_in, rows, places, path))
    if not numbers:
        raise InputError(f"{path} has no rows of numbers below its first row", key)
    table = dict(zip(names, np.array(numbers).T, strict=True))
    for name in errors:
        if not np.all(table[name] > 0.0):
            raise InputError(f"{path}: {name} must be positive, it is a standard error", key)
    sigma = {name: table[s] for name in columns for s in (SIGMA, f"{SIGMA}_{name}") if s in table}
    return Experiment(
        key,
        path,
        curve.set,
        table[TIME] if times else None,
        {name: table[name] for name in keys},
        {name: table[name] for name in columns},
        sigma,
        tuple(name for name in header if name not in names and name),
    )


def variables_of(parameters: Parameters) -> list[Variable]:
    """The numbers that are searched.  Raises InputError for keys that are no numbers."""
    assert parameters.fit is not None
    variables = []
    for key, entry in parameters.fit.parameters.items():
        place = f"fit.parameters.{key}"
        if entry.start is not None:
            try:
                with_start = with_values(parameters, {key: entry.start})
            except (InputError, KeyError) as error:
                raise InputError(f"{key} cannot be {entry.start:g}: {error}", place) from error
            start = number_at(with_start, key, place)
        else:
            start = number_at(parameters, key, place)
        least, largest = entry.limits
        is_log = entry.scale == "log"
        if not least <= start <= largest or (is_log and not start > 0.0):
            raise InputError(
                f"{key} starts at {start:g}, the value of the file, which its bounds exclude; give "
                "a start",
                place,
            )
        variables.append(Variable(key, start, least, largest, is_log))
    return variables


EVALUATIONS = "evaluations"
# The keys of a fit that ask for what the keys of derivatives ask for.
_ASKED = {"sensitivities.of": "fit.quantities", "sensitivities.to": "fit.parameters"}


@dataclass(frozen=True)
class Evaluation:
    """Quantities (k, q) after each of k steps, and their derivatives (k, q, n), if there are any.

    ``times`` are None without steps.  ``used`` is the largest share of the strain limit.
    """

    times: FloatArray | None
    values: FloatArray
    derivatives: FloatArray | None
    used: float | None

    def at(self, times: FloatArray | None, start: float) -> tuple[FloatArray, FloatArray | None]:
        """Values (r, q) and derivatives (r, q, n) at r times, linear between the steps.

        At the time before the first step a body at rest has zeros.
        """
        if times is None or self.times is None:
            return self.values, self.derivatives
        known = self.times if self.times[0] <= start else np.append(start, self.times)

        def between(values: FloatArray) -> FloatArray:
            zeros = np.zeros((len(known) - len(values), *values.shape[1:]))
            every = np.concatenate([zeros, values])
            return np.apply_along_axis(partial(np.interp, times, known), 0, every)

        slopes = self.derivatives
        return between(self.values), None if slopes is None else between(slopes)


class Model:
    """The solves of all experiments at numbers of the file; collective.

    Evaluations are kept in ``folder``.  ``derives`` turns False where derivatives are not known, as
    with iterative linear solvers, and ``refusal`` says why.
    """

    def __init__(
        self,
        parameters: Parameters,
        experiments: Sequence[Experiment],
        folder: Path,
        comm: MPI.Intracomm,
    ) -> None:
        assert parameters.fit is not None
        self.parameters, self._comm, self._folder = parameters, comm, folder
        self.experiments = experiments
        self.quantities = tuple(parameters.fit.quantities.items())
        self.keys = tuple(parameters.fit.parameters)
        self.cases = [case for experiment in experiments for case in experiment.cases()]
        self.derives, self.failure, self.refusal = True, "", ""
        self._domains: dict[str, Domain] = {}

    def case_parameters(self, case: Case, numbers: Sequence[float]) -> Parameters:
        """One solve at the numbers.  Raises InputError for values that do not fit."""
        values = {**case.changes, **dict(zip(self.keys, map(float, numbers), strict=True))}
        try:
            return with_values(self.parameters, values)
        except (InputError, KeyError) as error:
            text = error.args[0] if isinstance(error, KeyError) else str(error)
            raise InputError(
                f"{case.experiment.path}: these values do not fit: {values}; {text}",
                case.experiment.key,
            ) from error

    def evaluate(self, numbers: Sequence[float], is_first: bool) -> list[Evaluation] | None:
        """The solves of all cases; None where one has no solution, with the ``failure``.

        The errors of the ``first`` are raised.
        """
        evaluations = []
        for case in self.cases:
            try:
                evaluation = self._of_case(case, numbers)
            except ContactLockingError as error:
                if is_first:
                    raise
                self.failure = str(error).splitlines()[0]
                return None
            if evaluation is None:
                return None
            evaluations.append(evaluation)
        return evaluations

    def _of_case(self, case: Case, numbers: Sequence[float]) -> Evaluation | None:
        names = [quantity for _, quantity in self.quantities]
        asked = SensitivityParameters(of=tuple(dict.fromkeys(names)), to=self.keys)
        plain = self.case_parameters(case, numbers)
        derived = plain.model_copy(update={"sensitivities": asked})
        fingerprint = on_root(self._comm, partial(study_file.fingerprint, derived))
        while True:
            name = f"{fingerprint}{'' if self.derives else '-values'}.json"
            kept = self._comm.bcast(self._kept(name) if self._comm.rank == 0 else None, root=0)
            if kept is not None:
                return kept
            try:
                evaluation = self._solved(derived if self.derives else plain, names)
            except NoDerivatives as error:
                self.derives, self.refusal = False, str(error)
            except InputError as error:
                key = _ASKED.get(error.key or "", error.key)
                raise InputError(str(error), key) from error
            else:
                if evaluation is not None:
                    on_root_of(self._comm, self._folder, partial(self._keep, name, evaluation))
                return evaluation

    def _solved(self, parameters: Parameters, names: Sequence[str]) -> Evaluation | None:
        mesh = f"{parameters.mesh.model_dump()} {parameters.refined_names}"
        times: list[float] = []
        values: list[list[float]] = []
        slopes: list[list[list[float]]] = []
        used: list[float] = []
        for solution in solve_steps(parameters, self._comm, domain=self._domains.get(mesh)):
            self._domains[mesh] = solution.domain
            if not solution.converged:
                words = (solution.reason, solution.suggestion)
                self.failure = ".  ".join(filter(None, words))
                return None
            times.append(solution.time)
            values.append([value_of(name, solution) for name in names])
            if solution.facts.get("limit_used") is not None:
                used.append(solution.facts["limit_used"])
            if parameters.sensitivities is not None:
                derived = solution.facts["sensitivities"]
                slopes.append(
                    [[derived[name][key]["derivative"] for key in self.keys] for name in names]
                )
        evaluation = Evaluation(
            None if parameters.steps is None else np.array(times),
            np.array(values),
            np.array(slopes) if slopes else None,
            max(used, default=None),
        )
        # Sums over ranks are rounded alike on all, and the search takes the same path on each.
        return self._comm.bcast(evaluation, root=0)

    def _kept(self, name: str) -> Evaluation | None:
        data = read_mapping(self._folder / EVALUATIONS / name) or {}
        try:
            times, values, derivatives = (
                None if data[name] is None else np.array(data[name], dtype=float)
                for name in ("times", "values", "derivatives")
            )
            known = Evaluation(times, np.asarray(values, dtype=float), derivatives, data["used"])
        except (KeyError, TypeError, ValueError):
            return None
        return known if known.values.shape[-1:] == (len(self.quantities),) else None

    def _keep(self, name: str, evaluation: Evaluation) -> None:
        folder = self._folder / EVALUATIONS
        folder.mkdir(parents=True, exist_ok=True)
        data = vars(evaluation).items()
        plain = {key: None if x is None else np.asarray(x).tolist() for key, x in data}
        files.write_text(folder / name, json.dumps(plain) + "\n")
