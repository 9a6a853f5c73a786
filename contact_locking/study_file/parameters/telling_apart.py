"""Short texts for the values of a key that varies: of lists and mappings, what tells them apart."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any

from .wording import entry

#: Stands for the parts that are the same in all values.
SAME = "\N{HORIZONTAL ELLIPSIS}"
# These keys say what an entry of a list is about, such as the part of the boundary with a load.
_NAMING = ("on", "norm")
# A list of at most so many numbers, such as a vector, is one value.
_VECTOR = 3
_MOST_CHARACTERS = 72

Text = Callable[[Any], str]


def told_apart(values: Sequence[Any], text: Text = entry) -> list[str]:
    """A short text for each value; different values have different texts.

    Lists and mappings are written in brackets as in YAML, with … for the parts that all of them
    have in common. ``text`` writes a number or a word. Where it writes different values in the
    same way, as numbers that are rounded, `entry` writes them; texts that are the same even so,
    as they are cut, are numbered.
    """
    names = [_identity(value) for value in values]
    distinct = dict(zip(names, values, strict=True))
    found: list[str] = []
    for writer in (text, entry):
        found = [_cut(whole) for whole in _texts(list(distinct.values()), writer)]
        if len(set(found)) == len(found):
            break
    else:
        found = [f"{whole} (value {number})" for number, whole in enumerate(found, start=1)]
    texts = dict(zip(distinct, found, strict=True))
    return [texts[name] for name in names]


def labels(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """For each row its keys with their values, in one line; all rows have the same keys."""
    columns = [(key, told_apart([row[key] for row in rows])) for key in (rows[0] if rows else ())]
    return [
        ", ".join(f"{key} = {texts[number]}" for key, texts in columns)
        for number in range(len(rows))
    ]


def _texts(values: Sequence[Any], text: Text) -> list[str]:
    """The texts of values, which are compared with those of the same kind."""
    found = [""] * len(values)
    for kind, write in ((dict, _mappings), (list, _lists), (None, _words)):
        places = [place for place, value in enumerate(values) if _kind(value) is kind]
        alike = [values[place] for place in places]
        for place, written in zip(places, write(alike, text), strict=True):
            found[place] = written
    return found


def _words(values: Sequence[Any], text: Text) -> list[str]:
    return [text(value) for value in values]


def _mappings(values: Sequence[dict[Any, Any]], text: Text) -> list[str]:
    parts: list[list[str]] = [[] for _ in values]
    whole, same = _agree(values), False
    for key in dict.fromkeys(key for value in values for key in value):
        having = [place for place, value in enumerate(values) if key in value]
        column = [values[place][key] for place in having]
        if not whole and len(having) == len(values) and _agree(column) and key not in _NAMING:
            same = True
            continue
        for place, written in zip(having, _texts(column, text), strict=True):
            parts[place].append(f"{key}: {written}")
    return [f"{{{', '.join([*listed, SAME] if same else listed)}}}" for listed in parts]


def _lists(values: Sequence[Sequence[Any]], text: Text) -> list[str]:
    parts: list[list[str]] = [[] for _ in values]
    whole = _agree(values) or all(map(_is_vector, values))
    for index in range(max(map(len, values), default=0)):
        having = [place for place, value in enumerate(values) if index < len(value)]
        column = [values[place][index] for place in having]
        same = not whole and len(having) == len(values) and _agree(column)
        texts = [SAME] * len(column) if same else _texts(column, text)
        for place, written in zip(having, texts, strict=True):
            if not (same and parts[place][-1:] == [SAME]):
                parts[place].append(written)
    return [f"[{', '.join(listed)}]" for listed in parts]


def _is_vector(value: Sequence[Any]) -> bool:
    return len(value) <= _VECTOR and all(_kind(component) is None for component in value)


def _agree(values: Sequence[Any]) -> bool:
    return len(set(map(_identity, values))) < 2


def _kind(value: Any) -> type[dict[Any, Any]] | type[list[Any]] | None:
    if isinstance(value, list | tuple):
        return list
    return dict if isinstance(value, dict) else None


def _identity(value: Any) -> Hashable:
    """Equal for equal values: 1 is 1.0 but not true, and mappings have no order."""
    match value:
        case bool():
            return (bool, value)
        case dict():
            pairs = ((str(key), _identity(inside)) for key, inside in value.items())
            return (dict, frozenset(pairs))
        case list() | tuple():
            return (list, tuple(map(_identity, value)))
    return (None, value)


def _cut(text: str) -> str:
    return text if len(text) <= _MOST_CHARACTERS else f"{text[: _MOST_CHARACTERS - 1]}{SAME}"
