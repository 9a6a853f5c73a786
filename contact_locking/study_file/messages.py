"""The errors of pydantic as faults, in the words of the study file."""

from __future__ import annotations

import itertools
from typing import Any

from pydantic import ValidationError

from contact_locking.parameters import Parameters
from contact_locking.parameters.base import MOST_FAULTS, Fault, FaultsError
from contact_locking.parameters.keys import known_keys
from contact_locking.parameters.values import CHOICES
from contact_locking.parameters.wording import show, unknown_key, value_message
from contact_locking.plain_text import nearest

from .listing import rows

# The symbols of the formulas, which users may take for keys.
_SYMBOLS = {
    "M": "material.locking_limit",
    "E": "material.elasticity.young",
    "nu": "material.elasticity.poisson",
    "mu": "friction.coefficient",
    "f0": "loads.body_force",
    "g": "contact.gap",
    "r": "friction.smoothing.radius",
}


def faults_of(error: ValidationError) -> list[Fault]:
    """The faults with their places in the file; at most some 20 of them."""
    found: list[Fault] = []
    for details in itertools.islice(error.errors(include_url=False), MOST_FAULTS):
        place = tuple(part for part in details["loc"] if part not in CHOICES)
        cause = details.get("ctx", {}).get("error")
        if isinstance(cause, FaultsError):
            found += [Fault((*place, *fault.place), fault.message) for fault in cause.faults]
        else:
            found.append(Fault(place, str(cause) if cause else _message(details, place)))
    return found


def _message(details: Any, place: tuple[str | int, ...]) -> str:
    given = show(details["input"])
    match details["type"]:
        # A key without a value comes of a decimal comma: {gap: 0,1}.
        case "extra_forbidden" if (
            place[:-1] == ("contact",)
            and str(place[-1]).isdecimal()
            and details["input"] is not None
        ):
            return "contact is one section and not a list: leave the number out of the key"
        case "extra_forbidden":
            known = known_keys(Parameters, place[:-1])
            return unknown_key(str(place[-1]), known, _elsewhere(str(place[-1])))
        case "model_type" | "model_attributes_type" | "dict_type":
            keys = ", ".join(known_keys(Parameters, place))
            several = ", or a list of such mappings" if place == ("contact",) else ""
            with_keys = f" with keys among {keys}" if keys else ""
            return f"must be a mapping{with_keys}{several}, not {given}"
        case "literal_error":
            allowed = details["ctx"]["expected"].replace("'", "")
            guess = nearest(str(details["input"]), allowed.replace(" or ", ", ").split(", "))
            return f"must be {allowed}, not {given}{guess}"
    return value_message(details)


def _elsewhere(name: str) -> str:
    """The hint at a key of another section with this name, or for this symbol."""
    if name in _SYMBOLS:
        return f" (did you mean '{_SYMBOLS[name]}'?)"
    # A key in an entry of a list or a mapping is no single key of the file.
    keys = [row.key for row in rows() if "INDEX" not in row.key and "NAME" not in row.key]
    matches = [key for key in keys if key.rpartition(".")[2] == name]
    return f" (did you mean '{matches[0]}'?)" if matches else ""
