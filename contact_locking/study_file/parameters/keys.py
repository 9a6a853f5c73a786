"""The keys that sections have, found from their types."""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from contact_locking.meshes import BUILDERS
from contact_locking.study_file.parameters.mesh import MeshParameters, builder_types
from contact_locking.values.concept import ONLY, Concept
from contact_locking.values.kinds import OneOf

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
    found = [(path, section) for path, section in _choices(annotation) if section is not None]
    return found[0][0] if found else (), tuple(dict.fromkeys(section for _, section in found))


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
    found: dict[Path, None] = {}
    for name, field in visible_fields(model).items():
        key = (*above, name)
        for path, section in _choices(field.annotation):
            found |= {(*key, *path[:end]): None for end in range(len(path) + 1)}
            if section is not None:
                found |= dict.fromkeys(key_patterns(section, (*key, *path)))
    if model is MeshParameters:
        names = {name for builder in BUILDERS.values() for name in builder_types(builder)}
        found |= {(*above, name): None for name in sorted(names)}
    return tuple(found)


def known_keys(model: type[Concept], place: Sequence[str | int]) -> list[str]:
    """The keys of a mapping at ``place`` below ``model``; empty if no mapping can be there.

    Raises KeyError with the index of the first part of ``place`` that does not exist.
    """
    patterns: Sequence[tuple[str, ...]] = key_patterns(model)
    for depth, part in enumerate(place):
        fitting = (str(part), "NAME", "INDEX") if str(part).isdecimal() else (str(part), "NAME")
        patterns = [pattern[1:] for pattern in patterns if pattern and pattern[0] in fitting]
        if not patterns:
            raise KeyError(depth)
    names = dict.fromkeys(pattern[0] for pattern in patterns if pattern)
    return [name for name in names if name not in ("INDEX", "NAME")]
