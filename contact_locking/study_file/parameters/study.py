"""The cases of a study: the keys of the file that vary, and their values."""

from __future__ import annotations

import itertools
import math
import types
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np
from pydantic import BeforeValidator, Field
from pydantic.fields import FieldInfo

from contact_locking.meshes import BUILDERS
from contact_locking.study_file.parameters.problem import MeshParameters, builder_types
from contact_locking.study_file.parameters.wording import meant
from contact_locking.values.concept import ONLY, Concept, Fault, entry
from contact_locking.values.kinds import File, Number, NumberOrInfinite, OneOf, Text
from contact_locking.values.value import show

MAX_CASES, MAX_KEYS = 10_000, 100
_RANGES: dict[str, Any] = {"geometric": np.geomspace, "linear": np.linspace}


def _values(value: Any) -> Any:
    """Check a list of values, or a range as {geometric: [first, last, number of values]}."""
    if isinstance(value, list | tuple) and value:
        if any(isinstance(number, float) and math.isnan(number) for number in value):
            raise ValueError("must not contain .nan")
        return list(value)
    if isinstance(value, dict) and len(value) == 1 and next(iter(value)) in _RANGES:
        ((kind, limits),) = value.items()
        numbers = isinstance(limits, list | tuple) and all(
            isinstance(limit, int | float) and not isinstance(limit, bool) and abs(limit) < 1e300
            for limit in limits
        )
        if not numbers or len(limits) != 3 or not 2 <= (count := limits[2]) <= MAX_CASES:
            raise ValueError(
                f"a range is [first, last, number of values (2 to {MAX_CASES})], not {show(limits)}"
            )
        if count != int(count):
            raise ValueError(f"the number of values must be an integer, not {show(count)}")
        first, last = float(limits[0]), float(limits[1])
        if kind == "geometric" and not (first > 0 and last > 0):
            raise ValueError(f"a geometric range needs numbers > 0, not {show(limits)}")
        return {kind: [first, last, int(count)]}
    raise ValueError(
        "must be a list of values, {geometric: [first, last, count]} or "
        f"{{linear: [first, last, count]}}, not {show(value)}"
    )


def _expand(values: Any) -> list[Any]:
    if isinstance(values, list):
        return values
    ((kind, (first, last, count)),) = values.items()
    # Rounded to 12 digits, so that a value is 100 and not 100.00000000000004.
    return [float(f"{value:.12g}") for value in _RANGES[kind](first, last, count)]


Values = Annotated[Any, BeforeValidator(_values)]


class StudyParameters(Concept):
    """Every combination of the values in ``vary``, with those in ``zip`` taken side by side."""

    vary: dict[str, Values] = entry({}, "dotted keys with their values: every combination")
    zip: dict[str, Values] = entry({}, "dotted keys with lists of one length: side by side")

    def _faults(self) -> Iterator[Fault]:
        keys = [*self.vary, *self.zip]
        if not keys:
            yield Fault((), "give the keys to vary under vary or zip")
            return
        if len(keys) > MAX_KEYS:
            yield Fault((), f"varies {len(keys)} keys; at most {MAX_KEYS} are allowed")
            return
        for place in [*(("vary", key) for key in self.vary), *(("zip", key) for key in self.zip)]:
            key = place[1]
            if keys.count(key) > 1:
                yield Fault(place, "is in both vary and zip")
            if any(key.startswith(f"{other}.") for other in keys):
                yield Fault(place, "lies in another key that varies")
        lengths = {key: len(_expand(values)) for key, values in self.zip.items()}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{key} has {length}" for key, length in lengths.items())
            yield Fault(("zip",), f"the lists must be of one length: {listed}")
            return
        number = math.prod(len(_expand(values)) for values in self.vary.values())
        number *= next(iter(lengths.values()), 1)
        if number > MAX_CASES:
            yield Fault((), f"has {number} cases; at most {MAX_CASES} are allowed")

    def key_faults(self, model: type[Concept]) -> Iterator[Fault]:
        """The keys that ``model`` does not have, and keys that must not vary."""
        for kind, entries in (("vary", self.vary), ("zip", self.zip)):
            for key in entries:
                parts = key.split(".")
                if parts[0] == "study":
                    yield Fault((kind, key), "a study cannot vary itself")
                    continue
                if parts[:2] == ["output", "directory"]:
                    yield Fault((kind, key), "each case already has its own folder")
                    continue
                try:
                    known_keys(model, parts)
                except KeyError as error:
                    depth = error.args[0]
                    above = parts[:depth]
                    siblings = known_keys(model, above)
                    where = f" in {'.'.join(above)}" if above else ""
                    known = f"; known: {', '.join(siblings)}" if siblings else ""
                    guess = meant(parts[depth], siblings)
                    yield Fault((kind, key), f"no key '{parts[depth]}'{where}{guess}{known}")

    def cases(self) -> list[dict[str, Any]]:
        """The values of each case by dotted key; the last key of ``vary`` runs fastest."""
        rows = [_expand(values) for values in self.zip.values()]
        together = [dict(zip(self.zip, row, strict=True)) for row in zip(*rows, strict=True)]
        axes = [[(key, value) for value in _expand(values)] for key, values in self.vary.items()]
        return [
            row | dict(combination)
            for row in together or [{}]
            for combination in itertools.product(*axes)
        ]


_MOST = 100


class Curve(Concept):
    """The rows of a CSV file, and the keys that differ in its experiment."""

    file: File = entry(..., "a CSV file with a row of column names, relative to the study file")
    set: dict[str, Any] = entry(
        {}, "keys of the study file with their values in this experiment, such as contact.gap: 0.1"
    )


def _curves(value: Any) -> Any:
    """A list of curves, also of the name of one file, or of names."""
    entries = value if isinstance(value, list | tuple) else [value]
    return [{"file": curve} if isinstance(curve, str) else curve for curve in entries]


class FittedNumber(Concept):
    """Where the search for a number begins, and what it is searched between."""

    start: Number | None = entry(None, "the first value; null: that of the file")
    bounds: tuple[NumberOrInfinite, NumberOrInfinite] | None = entry(
        None, "the least and the largest value; null: none, or positive values with scale: log"
    )
    scale: Literal["linear", "log"] = entry(
        "linear", "log: the search takes the logarithm, for numbers of unknown magnitude"
    )

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the largest value."""
        if self.bounds is not None:
            return self.bounds
        return (0.0 if self.scale == "log" else -math.inf), math.inf

    def _faults(self) -> Iterator[Fault]:
        least, largest = self.limits
        if not least < largest:
            yield Fault(("bounds",), f"must ascend, but {largest:g} follows {least:g}")
        elif self.scale == "log" and least < 0.0:
            yield Fault(("bounds",), f"must not be negative with scale: log, as {least:g} is")
        elif self.start is not None and not (least <= self.start <= largest):
            yield Fault(("start",), f"must be within the bounds, {least:g} to {largest:g}")
        elif self.scale == "log" and self.start is not None and not self.start > 0.0:
            yield Fault(("start",), f"must be positive with scale: log, not {self.start:g}")


class FitParameters(Concept):
    """Numbers of the file that are fitted to measured curves, by `contact-locking fit`."""

    data: Annotated[
        tuple[Curve, ...],
        Field(min_length=1, max_length=_MOST),
        BeforeValidator(_curves, json_schema_input_type=str | tuple[str | Curve, ...]),
    ] = entry(..., "a CSV file, or a list of {file, set}, one for each experiment")
    quantities: dict[str, Text] = entry(
        ..., "the quantity in each measured column, such as force: reactions.top.1"
    )
    parameters: dict[str, FittedNumber] = entry(
        ..., "the numbers to fit, by their dotted keys, each with {start, bounds, scale}"
    )

    def _faults(self) -> Iterator[Fault]:
        if not self.quantities:
            yield Fault(("quantities",), "name the columns, such as force: reactions.top.1")
        if not self.parameters:
            yield Fault(("parameters",), "name numbers to fit, such as material.elasticity.young")


Path = tuple[str, ...]


def visible_fields(model: type[Concept]) -> dict[str, FieldInfo]:
    """The fields of a section by their names in a file."""
    return {
        field.alias or name: field
        for name, field in model.model_fields.items()
        if not field.exclude and field.alias != ONLY
    }


def sections_in(annotation: Any) -> tuple[Path, tuple[type[Concept], ...]]:
    """The sections that a type chooses from, and the steps to them: INDEX of a list, NAME."""
    choices = [(path, section) for path, section in _choices(annotation) if section is not None]
    return choices[0][0] if choices else (), tuple(dict.fromkeys(section for _, section in choices))


def _choices(annotation: Any) -> Iterator[tuple[Path, type[Concept] | None]]:
    """The sections and values that a type contains, with the steps to each."""
    if isinstance(annotation, type) and issubclass(annotation, Concept):
        yield (), annotation
        return
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (tuple, dict):
        step, inside = ("INDEX", arguments[0]) if origin is tuple else ("NAME", arguments[1])
        yield from (((step, *path), model) for path, model in _choices(inside))
    elif origin in (Annotated, Union, types.UnionType):
        marks = [mark for mark in arguments[1:] if isinstance(mark, OneOf)]
        choices = arguments[:1] if origin is Annotated else arguments
        for choice in marks[0].among(choices[0]).values() if marks else choices:
            yield from _choices(choice)
    else:
        yield (), None


@cache
def key_patterns(model: type[Any], above: Path = ()) -> tuple[Path, ...]:
    """All keys below a section by their parts, and their entries as INDEX of a list or NAME."""
    patterns: dict[Path, None] = {}
    for name, field in visible_fields(model).items():
        key = (*above, name)
        for path, section in _choices(field.annotation):
            patterns |= {(*key, *path[:end]): None for end in range(len(path) + 1)}
            if section is not None:
                patterns |= dict.fromkeys(key_patterns(section, (*key, *path)))
    if model is MeshParameters:
        names = {name for builder in BUILDERS.values() for name in builder_types(builder)}
        patterns |= {(*above, name): None for name in sorted(names)}
    return tuple(patterns)


def known_keys(model: type[Concept], place: Sequence[str | int]) -> list[str]:
    """The keys of a mapping at ``place`` below ``model``; empty if no mapping can be there.

    Raises KeyError with the index of the first part of ``place`` that does not exist.
    """
    patterns: Sequence[tuple[str, ...]] = key_patterns(model)
    for depth, step in enumerate(place):
        fitting = (str(step), "NAME", "INDEX") if str(step).isdecimal() else (str(step), "NAME")
        patterns = [pattern[1:] for pattern in patterns if pattern and pattern[0] in fitting]
        if not patterns:
            raise KeyError(depth)
    names = dict.fromkeys(pattern[0] for pattern in patterns if pattern)
    return [name for name in names if name not in ("INDEX", "NAME")]
