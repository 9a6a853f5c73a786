"""What pydantic finds wrong, in the words of the study file."""

from __future__ import annotations

import itertools
from typing import Any

from pydantic import ValidationError

from contact_locking.expressions import nearest
from contact_locking.parameters import Fault, FaultsError, Parameters
from contact_locking.parameters.base import MOST_FAULTS, show, type_message
from contact_locking.parameters.keys import known_keys


def faults_of(error: ValidationError) -> list[Fault]:
    """Every fault with its place from the top of the file; the first of very many."""
    found: list[Fault] = []
    for details in itertools.islice(error.errors(include_url=False), MOST_FAULTS):
        place = tuple(details["loc"])
        cause = details.get("ctx", {}).get("error")
        if isinstance(cause, FaultsError):
            found += [Fault((*place, *fault.place), fault.message) for fault in cause.faults]
        else:
            found.append(Fault(place, str(cause) if cause else _message(details, place)))
    return found


def _message(details: Any, place: tuple[str | int, ...]) -> str:
    given = show(details["input"])
    match details["type"]:
        case "extra_forbidden":
            known = known_keys(Parameters, place[:-1])
            guess = nearest(str(place[-1]), known) or _elsewhere(str(place[-1]))
            return f"unknown key{guess}; known here: {', '.join(known)}"
        case "missing":
            return "is missing"
        case "model_type" | "model_attributes_type" | "dict_type":
            keys = ", ".join(known_keys(Parameters, place))
            return f"must be a mapping{f' with keys among {keys}' if keys else ''}, not {given}"
        case "literal_error":
            allowed = details["ctx"]["expected"].replace("'", "")
            guess = nearest(str(details["input"]), allowed.replace(" or ", ", ").split(", "))
            return f"must be {allowed}, not {given}{guess}"
    return type_message(details)


def _elsewhere(key: str) -> str:
    """A hint at the section that has the key, if there is one."""
    for section in known_keys(Parameters, ()):
        if key in known_keys(Parameters, (section,)):
            return f" (did you mean '{section}.{key}'?)"
    return ""
