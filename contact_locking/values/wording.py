"""Values and errors of pydantic, in words of the study file."""

from __future__ import annotations

import math
import re
from typing import Any

from contact_locking.plain_text import nearest

from .value import Value

# Texts that YAML takes as they stand, and words that YAML takes for something else.
_PLAIN = re.compile(r"[^\W\d][\w ./*+^()-]*")
_WORDS = {"null", "true", "false", "yes", "no", "on", "off"}

#: By pydantic's name of an error; the words in braces are from the error's context.
_MESSAGES = {
    "greater_than": "must be > {gt}, not {given}",
    "greater_than_equal": "must be >= {ge}, not {given}",
    "less_than": "must be < {lt}, not {given}",
    "less_than_equal": "must be <= {le}, not {given}",
    "too_short": "has {actual_length} entries; at least {min_length} are needed",
    "too_long": "has {actual_length} entries; at most {max_length} are allowed",
    "bool_type": "must be true or false, not {given}",
    "int_type": "must be an integer, not {given}",
    "string_type": "must be text (in quotes, if it looks like a number), not {given}",
    "list_type": "must be a list{how_to_list}, not {given}",
    "tuple_type": "must be a list{how_to_list}, not {given}",
    "missing": "is missing",
    "extra_forbidden": "is not known here",
}


def show(value: Any) -> str:
    """A value as a message repeats it: in YAML's words and not too long."""
    match value:
        case Value():
            return show(value.data)
        case None:
            return "null"
        case bool():
            return str(value).lower()
        case float() if math.isnan(value):
            return ".nan"
        case float() if math.isinf(value):
            return ".inf" if value > 0 else "-.inf"
        case int():
            text = "a huge integer" if abs(value) >= 10**20 else str(value)
        case float():
            text = f"{value:g}" if float(f"{value:g}") == value else str(value)
        case list() | tuple():
            text = f"[{', '.join(map(entry, value[:10]))}{', ...' * (len(value) > 10)}]"
        case dict() if value:
            text = f"a mapping with the keys {', '.join(map(str, list(value)[:10]))}"
        case dict():
            text = "an empty mapping"
        case str():
            text = repr(value)
        case _:
            text = f"'{value}'"
    return text if len(text) <= 80 else f"{text[:77]}..."


def entry(value: Any) -> str:
    """A value as an entry of a list: a name is without quotes there, as in a study file."""
    plain = isinstance(value, str) and _PLAIN.fullmatch(value) and value.lower() not in _WORDS
    return value if plain else show(value)


def value_message(details: Any) -> str:
    """The message for an error of pydantic about one value."""
    if cause := details.get("ctx", {}).get("error"):
        return str(cause)
    given = details["input"]
    if details["type"] == "literal_error":
        allowed = details["ctx"]["expected"].replace("'", "")
        guess = nearest(str(given), allowed.replace(" or ", ", ").split(", "))
        return f"must be {allowed}, not {show(given)}{guess}"
    in_a_mapping = ", or of entries that begin with '- '" if isinstance(given, dict) else ""
    template = _MESSAGES.get(details["type"])
    if template is None:
        return f"cannot be {show(given)}: {details['msg'][:1].lower()}{details['msg'][1:]}"
    context = {name: show(bound) for name, bound in details.get("ctx", {}).items()}
    return template.format(given=show(given), how_to_list=f" in [ ]{in_a_mapping}", **context)
