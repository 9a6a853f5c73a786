"""Numbers of a study file by their keys, and studies with other numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from contact_locking.errors import InputError
from contact_locking.study_file.dump import plain
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.reading import assign

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
        raise InputError(f"{key}: {why}, so that there is no derivative by it", asked)
    value: Any = plain(parameters)
    for part in key.split("."):
        if isinstance(value, dict) and part in value:
            value = value[part]
        elif isinstance(value, list) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        else:
            named = key in (parameters.parameters or {})
            meant = f" (did you mean 'parameters.{key}'?)" if named else ""
            raise InputError(f"{key} is not given in the file{meant}", asked)
    if isinstance(value, str):
        raise InputError(
            f"{key} is {value!r}, and no number: give its numbers names in the section parameters, "
            "as parameters: {mu0: 0.3}, and take parameters.mu0",
            asked,
        )
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{key} is no number: there is no derivative by it", asked)
    if not math.isfinite(value):
        raise InputError(f"{key} is infinite: there is no derivative by it", asked)
    return float(value)


def with_number(parameters: Parameters, key: str, value: float) -> Parameters:
    """The same study with another number at a dotted key, and without derivatives of its own.

    Raises InputError for a number that the key does not take.
    """
    try:
        return with_values(parameters, {key: value})
    except ValueError as error:
        raise InputError(
            f"{key} has a bound at its value, beyond which a derivative needs to look",
            "sensitivities.to",
        ) from error


def with_values(parameters: Parameters, values: Mapping[str, Any]) -> Parameters:
    """One solve with other values at dotted keys: without derivatives, a fit and a study.

    Raises ValueError for values that the keys do not take, and KeyError for an unknown place.
    """
    data = plain(parameters)
    for section in ("sensitivities", "fit", "study"):
        data.pop(section, None)
    for key, value in values.items():
        assign(data, key, value)
    return Parameters.model_validate(data)
