"""Numbers of a study file by their keys, and those with names of their own in expressions."""

from __future__ import annotations

import math
import re
from typing import Any

from contact_locking.errors import InputError
from contact_locking.study_file.parameters import Parameters, expressions

from .dump import plain
from .source import assign

# What these sections say is no number that the equations depend on smoothly.
_NOT_SMOOTH = {
    "mesh": "changes the mesh, on which the equations do not depend smoothly",
    "discretisation": "changes the elements",
    "solver": "changes how the equations are solved, and not the equations",
    "steps": "changes the times at which the equations hold",
    "adapt": "changes the mesh",
    "certificate": "changes what is checked",
    "output": "changes the files",
    "study": "is no number of one solve",
    "sensitivities": "is what asks for derivatives",
    "title": "is no number",
}


def resolved(parameters: Parameters) -> Parameters:
    """The same problem with the numbers of ``parameters`` in the place of their names."""
    named = parameters.parameters
    if not named:
        return parameters
    pattern = re.compile(rf"\b(?:{'|'.join(map(re.escape, named))})\b(?!\s*\()")
    data = plain(parameters)
    del data["parameters"]
    for place, text, _ in expressions(parameters, ()):
        written = pattern.sub(lambda found: f"({named[found[0]]!r})", text)
        assign(data, ".".join(map(str, place)), written)
    return Parameters.model_validate(data)


def number_at(parameters: Parameters, key: str) -> float:
    """The number at a dotted key.  Raises InputError for a key without a derivative."""
    section = key.partition(".")[0]
    if section in _NOT_SMOOTH:
        raise InputError(f"{key} {_NOT_SMOOTH[section]}: there is no derivative by it", _TO)
    value: Any = plain(parameters)
    for part in key.split("."):
        if isinstance(value, dict) and part in value:
            value = value[part]
        elif isinstance(value, list) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        else:
            raise InputError(f"{key} is not given in the file", _TO)
    if isinstance(value, str):
        raise InputError(
            f"{key} is {value!r}, and no number: give its numbers names in the section parameters, "
            "as parameters: {mu0: 0.3}, and derive by parameters.mu0",
            _TO,
        )
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{key} is no number: there is no derivative by it", _TO)
    if not math.isfinite(value):
        raise InputError(f"{key} is infinite: there is no derivative by it", _TO)
    return float(value)


def with_number(parameters: Parameters, key: str, value: float) -> Parameters:
    """The same study with another number at a dotted key, and without derivatives of its own.

    Raises InputError for a number that the key does not take.
    """
    data = plain(parameters)
    data.pop("sensitivities", None)
    data.pop("study", None)
    assign(data, key, value)
    try:
        return Parameters.model_validate(data)
    except ValueError as error:
        raise InputError(
            f"{key} has a bound at its value, beyond which a derivative needs to look", _TO
        ) from error


_TO = "sensitivities.to"
