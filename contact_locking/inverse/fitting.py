"""A fit from the study file to its results: the search for the numbers, and the runs at its end."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.stats import chi2

from contact_locking import files, study_file
from contact_locking._version import __version__
from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.inverse.estimate import (
    NO_INFLUENCE,
    UNDETERMINED,
    Combination,
    Estimate,
    Residuals,
    Variable,
    estimate,
)
from contact_locking.inverse.model import (
    Evaluation,
    Experiment,
    Model,
    read_experiments,
    variables_of,
)
from contact_locking.parallel import on_root
from contact_locking.plain_text import count, per_cent
from contact_locking.results.output import FIT, FIT_PICTURE, on_root_of, reserved
from contact_locking.results.solution import Solution, summary_text
from contact_locking.running.run import run
from contact_locking.solver.monitor import Monitor
from contact_locking.study_file.parameters import Parameters

# A start at which a strain limit is nowhere reached is lowered to below the largest strain, at most
# so often where other limits are reached before it.
_LIMIT, _BELOW, _LOWERINGS = "locking_limit", 0.95, 3
# The share of the limit from which the body locks.
_LOCKS = 0.999


def fit(
    parameters: Parameters,
    directory: str | Path,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
) -> tuple[dict[str, Any], Solution]:
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
    search = Search(model, variables, monitor)
    for experiment in experiments:
        for name in experiment.unused:
            monitor.message(f"warning: {experiment.path}: the column {name[:60]!r} is not used")
    estimate = search.run()
    solution = _final_runs(model, estimate, target, comm, monitor)
    fingerprint = on_root(comm, partial(study_file.fit_fingerprint, parameters))
    content = search.content(estimate)
    content |= {"version": __version__, "fingerprint": fingerprint}
    problem = on_root_of(comm, target, partial(_write, target, content))
    if problem:
        monitor.message(f"warning: {problem}")
    return content, solution


def _final_runs(
    model: Model, estimate: Estimate, target: Path, comm: MPI.Intracomm, monitor: Monitor
) -> Solution:
    """Run each experiment at the numbers that were found, and return the first; collective."""
    cases = [
        [case for case in model.cases if case.experiment is data] for data in model.experiments
    ]
    if len(cases) > 1:
        monitor.message(f"the runs of {count(len(cases), 'experiment')}")
    solutions = []
    for number, (*_, case) in enumerate(cases):
        plain = model.case_parameters(case, list(map(float, estimate.numbers)))
        parameters = plain.model_copy(update={"sensitivities": model.parameters.sensitivities})
        folder = target / f"{number}-{case.experiment.path.stem}" if number else target
        with reserved(folder, comm) if number else nullcontext():
            solutions.append(run(parameters, folder, comm, monitor)[0])
    return solutions[0]


def _write(target: Path, content: dict[str, Any]) -> str | None:
    """Write fit.json and fit.png; why there is no picture."""
    problem = None
    with files.staging(target) as made:
        (made / FIT).write_text(summary_text(content), encoding="utf-8")
        try:
            from contact_locking.view.report.run_charts import fit_charts

            (made / FIT_PICTURE).write_bytes(fit_charts(content)[0].png)
        except ImportError as error:
            problem = f"no picture of the fit was drawn: {error.name} cannot be imported"
        for name in (FIT, FIT_PICTURE):
            files.replace_file(made / name, target / name)
    return problem


@dataclass(frozen=True)
class Compared:
    """A measured column of an experiment, with the model (k,) and its derivatives (k, n)."""

    experiment: Experiment
    column: str
    quantity: str
    model: FloatArray
    derivatives: FloatArray | None

    @property
    def name(self) -> str:
        return f"{self.experiment.path.name}, {self.column}"

    @property
    def data(self) -> FloatArray:
        """The measured values (k,)."""
        return self.experiment.data[self.column]

    @property
    def sigma(self) -> FloatArray | None:
        """The standard errors (k,), if they are given."""
        return self.experiment.sigma.get(self.column)

    @property
    def weights(self) -> FloatArray:
        """One over the standard errors, or over the largest of the data."""
        if self.sigma is not None:
            return np.asarray(1.0 / self.sigma)
        return np.full(len(self.data), 1.0 / (float(np.abs(self.data).max()) or 1.0))

    def as_mapping(self) -> dict[str, Any]:
        """For fit.json."""
        experiment = self.experiment
        along, over = "t", experiment.times
        if over is None and experiment.varied:
            along, over = next(iter(experiment.varied.items()))
        return {
            "file": experiment.path.name,
            "column": self.column,
            "quantity": self.quantity,
            "along": along,
            "over": [] if over is None else over.tolist(),
            "data": self.data.tolist(),
            "model": self.model.tolist(),
            "sigma": None if self.sigma is None else self.sigma.tolist(),
        }


class Search:
    """The least squares of a model over some numbers; collective."""

    def __init__(self, model: Model, variables: Sequence[Variable], monitor: Monitor) -> None:
        self._model, self._variables, self._monitor = model, variables, monitor
        self._keys = [variable.key for variable in variables]
        self._evaluations: dict[tuple[float, ...], list[Evaluation]] = {}
        self._remarks: list[str] = []
        #: The evaluations of the model so far, those without a solution among them.
        self.evaluations = 0

    def run(self) -> Estimate:
        """The numbers of the least squares.  Raises NotConverged without a solution at first."""
        self._begin()
        compared = self.compared(self._start)
        for curve in compared:
            self._warn(about_units(curve.name, curve.data, curve.model))
        if not self._model.derives:
            self._warn([f"{self._model.refusal}; without them each number takes one more solve"])
        has_errors = all(curve.sigma is not None for curve in compared)
        result = estimate(self._variables, self._misfit, has_errors, self._model.derives)
        if not np.isfinite(result.scatter):
            self._warn(["there are as many data as numbers, so that there is no standard error"])
        return result

    def _begin(self) -> None:
        """Evaluate the start, in which a strain limit that matters nowhere is lowered.

        It stays where the process has no solution with a lower one.  Raises NotConverged without a
        solution.
        """
        if self._misfit(self._start) is None:
            raise NotConverged(
                "the process has no solution at the start of the fit, and may have one at another "
                f"start; {self._model.failure}"
            )
        for _ in range(_LOWERINGS):
            before, evaluations = self._variables, self._evaluations[_place(self._start)]
            used = max((each.used for each in evaluations if each.used is not None), default=1.0)
            lowered = {}
            for variable in before if used < _LOCKS else ():
                number = max(_BELOW * used * variable.start, variable.least)
                if variable.key.endswith(_LIMIT) and number < variable.start:
                    lowered[variable.key] = dataclasses.replace(variable, start=number)
            if not lowered:
                break
            self._variables = [lowered.get(each.key, each) for each in before]
            if self._misfit(self._start) is None:
                self._variables = before
                break
            self._warn(
                [
                    f"{key}: nothing locks at the start, where the strain reaches "
                    f"{per_cent(used)} of the limit; the search begins at {each.start:.4g}, where "
                    "the body begins to lock"
                    for key, each in lowered.items()
                ]
            )

    @property
    def _start(self) -> FloatArray:
        return np.array([variable.start for variable in self._variables])

    def _warn(self, texts: Sequence[str]) -> None:
        for text in texts:
            self._remarks.append(text)
            self._monitor.message(f"warning: {text}")

    def _misfit(self, numbers: FloatArray) -> Residuals | None:
        place, progress = _place(numbers), ""
        if place not in self._evaluations:
            self.evaluations += 1
            evaluations = self._model.evaluate(place, is_first=self.evaluations == 1)
            pairs = zip(self._keys, place, strict=True)
            progress = ", ".join(f"{key} {value:.6g}" for key, value in pairs)
            progress = f"evaluation {self.evaluations}: {progress}"
            if evaluations is None:
                self._monitor.message(f"{progress}: {self._model.failure}")
                return None
            self._evaluations[place] = evaluations
        compared = self.compared(numbers)
        values = np.concatenate([(curve.model - curve.data) * curve.weights for curve in compared])
        slopes = [
            curve.derivatives * curve.weights[:, None]
            for curve in compared
            if curve.derivatives is not None
        ]
        if progress:
            self._monitor.message(f"{progress}, misfit {float(values @ values):.4g}")
        return Residuals(values, np.concatenate(slopes) if slopes else None)

    def compared(self, numbers: FloatArray) -> list[Compared]:
        """Each measured column with the model at numbers (n,) that were evaluated."""
        evaluations, model = self._evaluations[_place(numbers)], self._model
        steps = model.parameters.steps
        curves = []
        for data in model.experiments:
            values = np.zeros((len(data), len(model.quantities)))
            slopes = np.zeros((*values.shape, len(self._keys)))
            for case, evaluation in zip(model.cases, evaluations, strict=True):
                if case.experiment is data:
                    at, derivatives = evaluation.at(
                        case.times, 0.0 if steps is None else steps.start
                    )
                    values[case.rows] = at
                    if derivatives is not None:
                        slopes[case.rows] = derivatives
            for place, (column, quantity) in enumerate(model.quantities):
                if column in data.data:
                    rates = slopes[:, place] if model.derives else None
                    curves.append(Compared(data, column, quantity, values[:, place], rates))
        return curves

    def content(self, estimate: Estimate) -> dict[str, Any]:
        """The content of fit.json."""
        keys, remarks = self._keys, [*self._remarks]
        compared = self.compared(estimate.numbers)
        free = 1.0 - len(keys) / sum(len(curve.data) for curve in compared)
        for curve in compared:
            residuals = curve.model - curve.data
            remarks += about_residuals(curve.name, residuals, curve.data, curve.sigma, free)
        return {
            "parameters": {
                variable.key: {
                    "value": float(estimate.numbers[place]),
                    "standard_error": float(estimate.errors[place]),
                    "interval": estimate.intervals[place].tolist(),
                    "start": variable.start,
                    "at_bound": variable.key in estimate.at_bound,
                }
                for place, variable in enumerate(self._variables)
            },
            "correlation": estimate.correlation.tolist(),
            "misfit": estimate.misfit,
            "scatter": estimate.scatter,
            "undetermined": undetermined(estimate, keys),
            "combinations": [
                {
                    "powers": {key: float(pair.powers[place]) for place, key in enumerate(keys)},
                    "singular_value": pair.singular,
                    "standard_error": pair.error,
                }
                for pair in estimate.combinations
            ],
            "evaluations": self.evaluations,
            "converged": estimate.converged,
            "reason": estimate.reason,
            "words": remarks,
            "curves": [curve.as_mapping() for curve in compared],
        }


def _place(numbers: FloatArray) -> tuple[float, ...]:
    return tuple(map(float, numbers))


# Powers below this share are left out of the name of a combination.
_SMALL = 0.2
# Data and model that differ by this factor have other units.
_OTHER_UNITS = 1e3
# Residuals change their sign so much less often than noise, in standard deviations, if the model
# lacks something.  It tells where they are this share of the largest of the data.
_TOO_FEW, _NOISE = 2.6, 1e-3
# Residuals that noise would make so rarely are no noise.
_BY_CHANCE = 1e-3


def combination_name(combination: Combination, keys: Sequence[str]) -> str:
    """``young^0.71 mu^-0.70``, the largest power positive."""
    # Of powers that are the same but for rounding, the first is the largest.
    size = np.round(np.abs(combination.powers), 6)
    powers = combination.powers * np.sign(combination.powers[np.argmax(size)])
    order = [i for i in np.argsort(-size, kind="stable") if size[i] >= _SMALL]
    if len(order) == 1:
        return keys[order[0]]
    return " ".join(f"{keys[i]}^{powers[i]:.2f}" for i in order)


def undetermined(estimate: Estimate, keys: Sequence[str]) -> list[str]:
    """The numbers that the data bound on one side, and the combinations that they leave open."""
    bounds = [one_bound(float(low), float(high)) for low, high in estimate.intervals]
    one_sided = {key: bound for key, bound in zip(keys, bounds, strict=True) if bound}
    remarks = [f"{key}: {bound}; beyond, the misfit is flat" for key, bound in one_sided.items()]
    least = NO_INFLUENCE * estimate.combinations[0].singular
    for combination in estimate.combinations:
        name, is_open = combination_name(combination, keys), not combination.error <= UNDETERMINED
        if np.isinf(estimate.scatter):
            # Without residuals there is no noise to tell.
            is_open = combination.singular <= least
        if is_open and name not in one_sided:
            error = "the data do not depend on it"
            if np.isfinite(combination.error):
                error = f"its standard error is {per_cent(combination.error)}"
            remarks.append(f"{name}: {error}")
    return remarks


def one_bound(low: float | None, high: float | None) -> str:
    """``at least 0.18``, for an interval that is open on one side; empty for all others."""
    has_low, has_high = (end is not None and bool(np.isfinite(end)) for end in (low, high))
    if has_low == has_high:
        return ""
    return f"at least {low:.5g}" if has_low else f"at most {high:.5g}"


def about_units(column: str, data: FloatArray, model: FloatArray) -> list[str]:
    """Whether data and model at the start have magnitudes or signs that do not belong together."""
    of_data, of_model = (float(np.max(np.abs(values), initial=0.0)) for values in (data, model))
    if of_model == 0.0 and of_data > 0.0:
        return [f"{column}: the model has 0 at the start; does the body touch?"]
    if float(data @ model) < 0.0:
        return [f"{column}: the data and the model at the start have opposite signs"]
    if of_data > 0.0 and not 1.0 / _OTHER_UNITS < of_data / of_model < _OTHER_UNITS:
        return [
            f"{column}: the largest of the data is {of_data:.3g}, and the model has {of_model:.3g} "
            "at the start; are the units the same?"
        ]
    return []


def about_residuals(
    column: str, residuals: FloatArray, data: FloatArray, sigma: FloatArray | None, free: float
) -> list[str]:
    """Whether the residuals (k,) are noise, with standard errors if they are known.

    ``free`` is the share of the data that no fitted number has used up.
    """
    remarks = []
    if sigma is not None:
        total, freedom = float(np.sum((residuals / sigma) ** 2)), free * len(residuals)
        if freedom > 0.0 and chi2.sf(total, freedom) < _BY_CHANCE:
            remarks.append(
                f"{column}: the residuals are {np.sqrt(total / freedom):.1f} times their standard "
                "errors; the model lacks something, or the errors are larger"
            )
    size = float(np.sqrt(np.mean(residuals**2)))
    signs = np.sign(residuals[residuals != 0.0])
    changes, noise = int(np.sum(signs[1:] != signs[:-1])), 0.5 * max(len(signs) - 1, 0)
    too_few = changes < noise - _TOO_FEW * np.sqrt(0.5 * noise)
    if too_few and size > _NOISE * float(np.max(np.abs(data))):
        remarks.append(
            f"{column}: the residuals change their sign {changes} times, noise would do so about "
            f"{noise:.0f} times; the model lacks something, or its steps are too coarse"
        )
    return remarks


def rows(content: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """The table of a terminal, of the content of fit.json."""
    table: list[tuple[str, ...]] = []
    has_scatter = content["scatter"] is not None and bool(np.isfinite(content["scatter"]))
    for key, entry in content["parameters"].items():
        error, (low, high) = entry["standard_error"], entry["interval"]
        if bound := one_bound(low, high):
            precision, between = bound, "95 %"
        elif error is None or not np.isfinite(error):
            precision = "not determined" if has_scatter else "no standard error"
            between = ""
        else:
            precision, between = f"± {error:.2g}", f"95 %: {low:.5g} to {high:.5g}"
        place = "at a bound" if entry["at_bound"] else ""
        table.append((key, f"{entry['value']:.6g}", precision, between, place))
    numbers = sum(len(curve["data"]) for curve in content["curves"])
    precision = count(content["evaluations"], "evaluation")
    table.append(("misfit", f"{content['misfit']:.4g}", f"of {numbers} numbers", precision, ""))
    return table
