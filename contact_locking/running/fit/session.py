"""A fit from the study file to its results."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError, NotConverged
from contact_locking.files import atomic, ownership
from contact_locking.monitor import Monitor
from contact_locking.parallel import on_root
from contact_locking.plain_text import count
from contact_locking.process.solving import solve
from contact_locking.results.names import FIT, FIT_PICTURE
from contact_locking.results.output_folder import KEY, on_root_of, reserved
from contact_locking.results.solution import StudySolution
from contact_locking.results.summary import summary_text
from contact_locking.running import writing
from contact_locking.running.process import run_steps
from contact_locking.study_file.named_numbers import number_at, with_values
from contact_locking.study_file.parameters import Parameters

from . import words
from .curves import Experiment, read_experiments
from .estimate import Estimate, Residuals, Variable, estimate
from .model import Evaluation, Model


def fit(
    parameters: Parameters,
    directory: str | Path,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
) -> tuple[dict[str, Any], StudySolution]:
    """Fit numbers of a study file to its curves: the content of fit.json, and the last solution.

    ``directory`` gets the run at the numbers that were found, fit.json and fit.png; the runs of
    further experiments are in folders below it with the names of their files.  Evaluations stay in
    ``directory``/evaluations, where a fit that was ended finds them.  Collective.  Raises
    InputError for data or keys that cannot be used, and NotConverged without a solution at the
    start.
    """
    monitor, target = monitor or Monitor(), Path(directory)
    experiments = on_root(comm, partial(read_experiments, parameters))
    variables = variables_of(parameters)
    model = Model(parameters, experiments, target, comm)
    search = _Search(model, experiments, variables, monitor)
    for one in experiments:
        for name in one.unused:
            monitor.message(f"warning: {one.path}: the column {name[:60]!r} is not used")
    found = search.run()
    solution = _final_runs(model, found, target, comm, monitor)
    content = search.content(found)
    problem = on_root_of(comm, target, partial(_write, target, content))
    if problem:
        monitor.message(f"warning: {problem}")
    return content, solution


def variables_of(parameters: Parameters) -> list[Variable]:
    """The numbers that are searched.  Raises InputError for keys that are no numbers."""
    assert parameters.fit is not None
    found = []
    for key, given in parameters.fit.parameters.items():
        place = f"fit.parameters.{key}"
        if given.start is not None:
            try:
                with_start = with_values(parameters, {key: given.start})
            except (ValueError, KeyError) as error:
                raise InputError(f"{key} does not take {given.start:g}: {error}", place) from error
            start = number_at(with_start, key, place)
        else:
            start = number_at(parameters, key, place)
        least, largest = given.limits
        is_log = given.scale == "log"
        if not least <= start <= largest or (is_log and not start > 0.0):
            raise InputError(
                f"{key} starts at {start:g}, the value of the file, which its bounds exclude; give "
                "a start",
                place,
            )
        found.append(Variable(key, start, least, largest, is_log))
    return found


class _Search:
    """The misfit of the model, and what there is to say about it."""

    def __init__(
        self,
        model: Model,
        experiments: Sequence[Experiment],
        variables: Sequence[Variable],
        monitor: Monitor,
    ) -> None:
        self._model, self._variables, self._monitor = model, variables, monitor
        self._experiments = experiments
        self.keys = [variable.key for variable in variables]
        self._has_errors = all(name in one.sigma for one in experiments for name in one.data)
        self._evaluations: dict[tuple[float, ...], list[Evaluation]] = {}
        self._tries = 0
        self.said: list[str] = []

    def run(self) -> Estimate:
        """The least squares."""
        start = np.array([variable.start for variable in self._variables])
        at_start = self._misfit(start)
        if at_start is None:
            raise NotConverged(
                f"the process has no solution at the start of the fit: {self._model.failure}; give "
                "another start"
            )
        self._before(start, at_start)
        return estimate(self._variables, self._misfit, self._has_errors, self._model.derives)

    def _before(self, start: FloatArray, at_start: Residuals) -> None:
        """Say before the search what cannot be found."""
        evaluations = self._evaluations[tuple(start)]
        for one, name, data, model, _ in self._curves(start):
            self._say(words.about_units(f"{one.path.name}, {name}", data, model))
        if at_start.derivatives is None:
            self._say(
                ["derivatives take solver.linear: direct; without, each number takes one more solve"]
            )
            return
        used = [item.used for item in evaluations if item.used is not None]
        self._say(words.before(at_start.derivatives * start, self.keys, max(used, default=None)))

    def _say(self, texts: Sequence[str]) -> None:
        for text in texts:
            self.said.append(text)
            self._monitor.message(f"warning: {text}")

    def _misfit(self, numbers: FloatArray) -> Residuals | None:
        place = tuple(map(float, numbers))
        if place not in self._evaluations:
            self._tries += 1
            found = self._model.evaluate(place, is_first=not self._evaluations)
            told = ", ".join(
                f"{key} {value:.6g}" for key, value in zip(self.keys, place, strict=True)
            )
            if found is None:
                self._monitor.message(f"evaluation {self._tries}: {told}: {self._model.failure}")
                return None
            self._evaluations[place] = found
            residuals = self._residuals(place)
            size = float(residuals.values @ residuals.values)
            self._monitor.message(f"evaluation {self._tries}: {told}, misfit {size:.4g}")
            return residuals
        return self._residuals(place)

    def _residuals(self, numbers: Sequence[float]) -> Residuals:
        values, slopes = [], []
        for one, name, data, model, derivatives in self._curves(numbers):
            weight = 1.0 / self._sigma(one, name)
            values.append((model - data) * weight)
            if derivatives is not None:
                slopes.append(derivatives * np.reshape(weight, (-1, 1)))
        return Residuals(np.concatenate(values), np.concatenate(slopes) if slopes else None)

    @staticmethod
    def _sigma(one: Experiment, name: str) -> FloatArray:
        """The standard errors of a column, or the largest of its data for all."""
        if name in one.sigma:
            return one.sigma[name]
        largest = float(np.abs(one.data[name]).max()) or 1.0
        return np.full(len(one.data[name]), largest)

    def _curves(
        self, numbers: Sequence[float]
    ) -> list[tuple[Experiment, str, FloatArray, FloatArray, FloatArray | None]]:
        """Each measured column with its data (k,), the model (k,) and its derivatives (k, n)."""
        evaluations, model = self._evaluations[tuple(map(float, numbers))], self._model
        steps = model.parameters.steps
        start = 0.0 if steps is None else steps.start
        found = []
        for one in self._experiments:
            count_ = len(next(iter(one.data.values())))
            values = np.zeros((count_, len(model.quantities)))
            slopes = np.zeros((*values.shape, len(self.keys)))
            for case, evaluation in zip(model.cases, evaluations, strict=True):
                if case.experiment is one:
                    at, derivatives = evaluation.at(case.times, start)
                    values[case.rows] = at
                    if derivatives is not None:
                        slopes[case.rows] = derivatives
            for place, (name, _) in enumerate(model.quantities):
                if name in one.data:
                    own = slopes[:, place] if model.derives else None
                    found.append((one, name, one.data[name], values[:, place], own))
        return found

    def content(self, found: Estimate) -> dict[str, Any]:
        """The content of fit.json."""
        parameters = {
            variable.key: {
                "value": float(found.numbers[place]),
                "standard_error": float(found.errors[place]),
                "interval": found.intervals[place].tolist(),
                "start": variable.start,
                "at_bound": variable.key in found.at_bound,
            }
            for place, variable in enumerate(self._variables)
        }
        curves, quantities = [], dict(self._model.quantities)
        told = list(self.said)
        for one, name, data, model, _ in self._curves(found.numbers):
            along, over = ("t", one.times) if one.times is not None else ("", None)
            if over is None and one.varied:
                along, over = next(iter(one.varied.items()))
            curves.append(
                {
                    "file": one.path.name,
                    "column": name,
                    "quantity": quantities[name],
                    "along": along,
                    "over": [] if over is None else over.tolist(),
                    "data": data.tolist(),
                    "model": model.tolist(),
                    "sigma": one.sigma[name].tolist() if name in one.sigma else None,
                }
            )
            scatter = found.scatter if self._has_errors else None
            told += words.about_residuals(
                f"{one.path.name}, {name}", model - data, data, scatter
            )
        lost = words.undetermined(found, self.keys)
        return {
            "parameters": parameters,
            "correlation": found.correlation.tolist(),
            "misfit": found.misfit,
            "scatter": found.scatter,
            "undetermined": lost,
            "combinations": [
                {
                    "powers": dict(zip(self.keys, one.powers.tolist(), strict=True)),
                    "singular_value": one.singular,
                    "standard_error": one.error,
                }
                for one in found.combinations
            ],
            "evaluations": len(self._evaluations),
            "converged": found.converged,
            "reason": found.reason,
            "words": told,
            "curves": curves,
        }


def _final_runs(
    model: Model, found: Estimate, target: Path, comm: MPI.Intracomm, monitor: Monitor
) -> StudySolution:
    """Run each experiment at the numbers that were found; collective."""
    first: StudySolution | None = None
    last_cases = {id(case.experiment): case for case in model.cases}
    several = len(last_cases)
    if several > 1:
        monitor.message(f"the runs of {count(several, 'experiment')}")
    for number, case in enumerate(last_cases.values()):
        folder = target if number == 0 else target / f"{number}-{case.experiment.path.stem}"
        given = model.parameters
        wanted = model.case_parameters(case, found.numbers).model_copy(
            update={"sensitivities": given.sensitivities}
        )
        if number == 0:
            first = _run(wanted, folder, comm, monitor)
            continue
        with reserved(folder, comm):
            _run(wanted, folder, comm, monitor)
    assert first is not None
    return first


def _run(
    parameters: Parameters, folder: Path, comm: MPI.Intracomm, monitor: Monitor
) -> StudySolution:
    if parameters.steps is not None:
        return run_steps(parameters, folder, comm, monitor)[0]
    solution = solve(parameters, comm, monitor)
    writing.write(solution, folder)
    return solution


def _write(target: Path, content: dict[str, Any]) -> str | None:
    """Write fit.json and fit.png; why there is no picture."""
    problem = None
    with atomic.staging(target) as made:
        (made / FIT).write_text(summary_text(content), encoding="utf-8")
        try:
            from contact_locking.extras.report.fit_charts import fit_chart

            (made / FIT_PICTURE).write_bytes(fit_chart(content).png)
        except ImportError as error:
            problem = f"no picture of the fit was drawn: {error.name} cannot be imported"
        ownership.replace(target, made, (FIT, FIT_PICTURE), KEY)
    return problem
