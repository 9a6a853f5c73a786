"""The search for the numbers of a fit: the misfit of the model, and what is to be said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.monitor import Monitor

from . import words
from .curves import Experiment
from .estimate import Estimate, Residuals, Variable, estimate
from .model import Evaluation, Model


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
        one = self.experiment
        along, over = "t", one.times
        if over is None and one.varied:
            along, over = next(iter(one.varied.items()))
        return {
            "file": one.path.name,
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
        self._said: list[str] = []
        #: The evaluations of the model so far, those without a solution among them.
        self.evaluations = 0

    def run(self) -> Estimate:
        """The numbers of the least squares.  Raises NotConverged without a solution at first."""
        start = np.array([variable.start for variable in self._variables])
        at_start = self._misfit(start)
        if at_start is None:
            raise NotConverged(
                "the process has no solution at the start of the fit, and may have one at another "
                f"start; {self._model.failure}"
            )
        compared = self.compared(start)
        for one in compared:
            self._say(words.about_units(one.name, one.data, one.model))
        used = [item.used for item in self._evaluations[_place(start)] if item.used is not None]
        most = max(used, default=None)
        self._say(words.before(at_start, start, self._keys, most, self._model.refusal))
        has_errors = all(one.sigma is not None for one in compared)
        return estimate(self._variables, self._misfit, has_errors, self._model.derives)

    def _say(self, texts: Sequence[str]) -> None:
        for text in texts:
            self._said.append(text)
            self._monitor.message(f"warning: {text}")

    def _misfit(self, numbers: FloatArray) -> Residuals | None:
        place = _place(numbers)
        if place not in self._evaluations:
            self.evaluations += 1
            found = self._model.evaluate(place, is_first=self.evaluations == 1)
            pairs = zip(self._keys, place, strict=True)
            told = ", ".join(f"{key} {value:.6g}" for key, value in pairs)
            told = f"evaluation {self.evaluations}: {told}"
            if found is None:
                self._monitor.message(f"{told}: {self._model.failure}")
                return None
            self._evaluations[place] = found
            residuals = self._residuals(numbers)
            size = float(residuals.values @ residuals.values)
            self._monitor.message(f"{told}, misfit {size:.4g}")
        return self._residuals(numbers)

    def _residuals(self, numbers: FloatArray) -> Residuals:
        values, slopes = [], []
        for one in self.compared(numbers):
            values.append((one.model - one.data) * one.weights)
            if one.derivatives is not None:
                slopes.append(one.derivatives * one.weights[:, None])
        return Residuals(np.concatenate(values), np.concatenate(slopes) if slopes else None)

    def compared(self, numbers: FloatArray) -> list[Compared]:
        """Each measured column with the model at numbers (n,) that were evaluated."""
        evaluations, model = self._evaluations[_place(numbers)], self._model
        steps = model.parameters.steps
        found = []
        for one in model.experiments:
            values = np.zeros((len(one), len(model.quantities)))
            slopes = np.zeros((*values.shape, len(self._keys)))
            for case, evaluation in zip(model.cases, evaluations, strict=True):
                if case.experiment is one:
                    at, derivatives = evaluation.at(
                        case.times, 0.0 if steps is None else steps.start
                    )
                    values[case.rows] = at
                    if derivatives is not None:
                        slopes[case.rows] = derivatives
            for place, (column, quantity) in enumerate(model.quantities):
                if column in one.data:
                    own = slopes[:, place] if model.derives else None
                    found.append(Compared(one, column, quantity, values[:, place], own))
        return found

    def content(self, found: Estimate, starts: Sequence[dict[str, Any]] = ()) -> dict[str, Any]:
        """The content of fit.json; ``starts`` has a row for each of several searches."""
        keys, told = self._keys, [*self._said, *words.about_starts(starts, found.misfit)]
        compared = self.compared(found.numbers)
        free = 1.0 - len(keys) / sum(len(one.data) for one in compared)
        for one in compared:
            left = one.model - one.data
            told += words.about_residuals(one.name, left, one.data, one.sigma, free)
        return {
            "parameters": {
                variable.key: {
                    "value": float(found.numbers[place]),
                    "standard_error": float(found.errors[place]),
                    "interval": found.intervals[place].tolist(),
                    "start": variable.start,
                    "at_bound": variable.key in found.at_bound,
                }
                for place, variable in enumerate(self._variables)
            },
            "correlation": found.correlation.tolist(),
            "misfit": found.misfit,
            "scatter": found.scatter,
            "undetermined": words.undetermined(found, keys),
            "combinations": [
                {
                    "powers": {key: float(one.powers[place]) for place, key in enumerate(keys)},
                    "singular_value": one.singular,
                    "standard_error": one.error,
                }
                for one in found.combinations
            ],
            "evaluations": self.evaluations,
            "converged": found.converged,
            "reason": found.reason,
            "words": told,
            "starts": list(starts),
            "curves": [one.as_mapping() for one in compared],
        }


def _place(numbers: FloatArray) -> tuple[float, ...]:
    return tuple(map(float, numbers))
