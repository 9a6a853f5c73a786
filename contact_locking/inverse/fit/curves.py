"""Measured curves: the columns of CSV files, by what they mean.

A column is ``t``, a dotted key of the study file that varies from row to row, a quantity that the
file names, or a standard error: ``sigma`` of all quantities, or ``sigma_force`` of ``force``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError, with_key
from contact_locking.files.readable import number_at, place_of, rows_of
from contact_locking.plain_text import count
from contact_locking.study_file.parameters import Parameters
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
    given = parameters.fit
    if given is None:
        raise InputError(
            "the file has no section fit; add one with data, quantities and parameters, as "
            "docs/guides/fit.md has it"
        )
    several = len(given.data) > 1
    found = [
        _read(curve, f"fit.data.{number}" if several else "fit.data", given)
        for number, curve in enumerate(given.data)
    ]
    for name in given.quantities:
        if not any(name in one.data for one in found):
            path = Path(given.data[0].file)
            with rows_of(path, "fit.data") as rows:
                header = [cell.strip() for cell in next(rows, [])]
                with_key("fit.quantities", partial(place_of, name, header, path))
    steps = parameters.steps
    for one in found:
        problem = ""
        if steps is None and one.times is not None:
            problem = (
                "has a column t, and the file has no steps: add a section such as "
                "steps: {to: 1, count: 20}, or name the column by the key that varies"
            )
        elif steps is None and not one.varied and len(one) > 1:
            problem = (
                "has several rows, and nothing that differs between them: neither a column t nor "
                "one with a key of the study file, as contact.gap"
            )
        elif steps is not None and one.times is None:
            problem = "has no column t, the times at which the steps are compared"
        elif steps is not None and one.times is not None:
            first, last = float(one.times.min()), float(one.times.max())
            if first < steps.start or last > steps.planned[-1] * (1.0 + 1e-9):
                problem = (
                    f"has times from {first:g} to {last:g}, and the steps go from {steps.start:g} "
                    f"to {steps.planned[-1]:g}; are the units the same?"
                )
        if problem:
            raise InputError(f"{one.path} {problem}", one.key)
    numbers, wanted = sum(one.count for one in found), len(given.parameters)
    if numbers < wanted:
        raise InputError(
            f"{count(wanted, 'parameter')} to fit and {count(numbers, 'measured number')}: give "
            "more data, or fit fewer parameters",
            "fit.parameters",
        )
    return found


def _read(curve: Curve, key: str, given: FitParameters) -> Experiment:
    """The experiment of a file.  Raises InputError with the row of what is wrong."""
    path = Path(curve.file)
    with rows_of(path, key) as rows:
        header = [cell.strip() for cell in next(rows, [])]
        columns = [name for name in given.quantities if name in header]
        if not columns:
            first = next(iter(given.quantities))
            with_key("fit.quantities", partial(place_of, first, header, path))
        keys = [name for name in header if "." in name]
        errors = [name for name in (SIGMA, *(f"{SIGMA}_{c}" for c in columns)) if name in header]
        times = [TIME] if TIME in header else []
        wanted = [*times, *keys, *columns, *errors]
        places = [with_key(key, partial(place_of, name, header, path)) for name in wanted]
        numbers: list[list[float]] = []
        for line, row in enumerate(rows, 2):
            if not any(cell.strip() for cell in row):
                continue
            read = [number_at(place, row) for place in places]
            for name, (value, text) in zip(wanted, read, strict=True):
                if not math.isfinite(value):
                    raise InputError(
                        f"{path}, row {line}, {name}: {text!r} is no finite number", key
                    )
            numbers.append([value for value, _ in read])
    if not numbers:
        raise InputError(f"{path} has no rows of numbers below its first row", key)
    table = dict(zip(wanted, np.array(numbers).T, strict=True))
    for name in errors:
        if not np.all(table[name] > 0.0):
            raise InputError(f"{path}: {name} must be positive, it is a standard error", key)
    sigma = {
        name: table[own] for name in columns for own in (SIGMA, f"{SIGMA}_{name}") if own in table
    }
    return Experiment(
        key,
        path,
        curve.set,
        table[TIME] if times else None,
        {name: table[name] for name in keys},
        {name: table[name] for name in columns},
        sigma,
        tuple(name for name in header if name not in wanted and name),
    )
