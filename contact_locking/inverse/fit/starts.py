"""Where the searches of a fit begin; several of them are solved as the cases of a study.

The first begins at the numbers of the file.  The others are a Latin hypercube between the bounds:
each number takes each of as many parts of its range once.  A number without a bound ranges over a
tenth to ten times its start with a log scale, else from zero to twice its start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from contact_locking import study_file
from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError, NotConverged
from contact_locking.inverse.numbers import number_at, with_values
from contact_locking.running.cases import Case, case_folder
from contact_locking.running.runner import Plan, Say, Study, finish
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.wording import labels

from .curves import read_experiments
from .estimate import Variable

FOLDER = "starts"
# Misfits that differ by this share are the same: the first of their searches is the best.
_SAME = 1e-3


@dataclass(frozen=True)
class Begun:
    """The best of several searches: its study, the folder of its evaluations, and a row for each.

    A row has the ``start``, and the ``value`` and ``misfit`` at the end, None without one.
    """

    parameters: Parameters
    folder: Path
    rows: list[dict[str, Any]]


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


def starts_of(variables: Sequence[Variable], number: int) -> FloatArray:
    """The numbers (s, n) where s searches begin."""
    random, others = np.random.default_rng(0), number - 1
    columns = []
    for variable in variables:
        low, high = map(variable.searched, _range_of(variable))
        places = (random.permutation(others) + random.random(others)) / max(others, 1)
        among = [variable.number(low + (high - low) * float(place)) for place in places]
        columns.append([variable.start, *among])
    return np.array(columns).T


def _range_of(variable: Variable) -> tuple[float, float]:
    start, least, largest = variable.start, variable.least, variable.largest
    if variable.is_log:
        return least or 0.1 * start, largest if np.isfinite(largest) else 10.0 * start
    reach = abs(start) or 1.0
    low = least if np.isfinite(least) else start - reach
    return low, largest if np.isfinite(largest) else start + reach


def search(parameters: Parameters, plan: Plan, say: Say) -> Begun:
    """Search from all starts, of which those that are done are found again.

    Raises InputError for data or keys that cannot be used, and NotConverged if no search comes to
    an end; others as :func:`contact_locking.running.runner.finish`.
    """
    assert parameters.fit is not None
    read_experiments(parameters)
    variables = variables_of(parameters)
    keys = [variable.key for variable in variables]
    starts = [
        dict(zip(keys, map(float, row), strict=True))
        for row in starts_of(variables, parameters.fit.starts)
    ]
    folder = Path(parameters.output.directory) / FOLDER
    cases = [
        _case(parameters, start, label, folder)
        for start, label in zip(starts, labels(starts), strict=True)
    ]
    study = Study(folder, cases)
    finish(study, parameters, plan, say)
    found = [study.outcomes[case.name] for case in cases]
    ends = [
        (not one.summary["converged"], one.summary["misfit"]) if one.summary else None
        for one in found
    ]
    ended = [end for end in ends if end is not None]
    if not ended:
        raise NotConverged(
            f"none of {len(cases)} searches has come to an end; the first: {found[0].reason}"
        )
    unfinished, misfit = min(ended)
    alike = unfinished, misfit * (1.0 + _SAME)
    best = next(case for case, end in zip(cases, ends, strict=True) if end and end <= alike)
    rows = []
    for start, one in zip(starts, found, strict=True):
        # The content of fit.json.
        content = one.summary or {"parameters": None, "misfit": None, "evaluations": None}
        value = content["parameters"] and {
            key: entry["value"] for key, entry in content["parameters"].items()
        }
        row = {name: content[name] for name in ("misfit", "evaluations")}
        rows.append({"start": start, "state": one.state, "value": value, **row})
    return Begun(best.parameters, best.folder, rows)


def _case(parameters: Parameters, start: dict[str, float], label: str, folder: Path) -> Case:
    """A search of its own, with one start."""
    assert parameters.fit is not None
    numbers = {
        key: given.model_copy(update={"start": start[key]})
        for key, given in parameters.fit.parameters.items()
    }
    fit = parameters.fit.model_copy(update={"parameters": numbers, "starts": 1})
    alone = parameters.model_copy(update={"fit": fit, "study": None})
    name = study_file.fit_fingerprint(alone)
    place = case_folder(folder, name)
    output = parameters.output.model_copy(update={"directory": str(place)})
    wanted = alone.model_copy(update={"output": output})
    return Case(dict(start), label, name, place, wanted, "fit")
