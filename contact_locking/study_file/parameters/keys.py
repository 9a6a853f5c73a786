"""The keys that sections have, found from their types."""

from __future__ import annotations

import types
from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from contact_locking.meshes import BUILDERS

from .mesh import MeshParameters, builder_types


def visible_fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of a section by their names in a file."""
    return {
        field.alias or name: field
        for name, field in model.model_fields.items()
        if not field.exclude
    }


def section_in(annotation: Any) -> tuple[tuple[str, ...], type[BaseModel] | None]:
    """The section that a type contains, if any, and the steps to it: INDEX of a list, NAME."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return (), annotation
    origin, arguments = get_origin(annotation), get_args(annotation)
    steps: dict[Any, tuple[tuple[str, ...], tuple[Any, ...]]] = {
        tuple: (("INDEX",), arguments[:1]),
        dict: (("NAME",), arguments[1:]),
        Annotated: ((), arguments[:1]),
        Union: ((), arguments),
        types.UnionType: ((), arguments),
    }
    step, inner = steps.get(origin, ((), ()))
    for argument in inner:
        path, model = section_in(argument)
        if path or model is not None:
            return (*step, *path), model
    return step, None


def may_be_list(annotation: Any) -> bool:
    """Whether a section of this type may stand in the file once, or in a list."""
    choices = [section_in(choice) for choice in get_args(annotation)]
    steps = [path for path, model in choices if model is not None]
    return () in steps and ("INDEX",) in steps


def may_be_vector(annotation: Any) -> bool:
    """Whether a section of this type has a list of values as its short form."""
    choices = [section_in(choice) for choice in _choices(annotation)]
    return (("INDEX",), None) in choices and any(model is not None for _, model in choices)


def _choices(annotation: Any) -> list[Any]:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _choices(arguments[0])
    if origin in (Union, types.UnionType):
        return [choice for argument in arguments for choice in _choices(argument)]
    return [annotation]


@cache
def key_patterns(
    model: type[BaseModel], above: tuple[str, ...] = ()
) -> tuple[tuple[str, ...], ...]:
    """All keys below a section by their parts, and their entries as INDEX of a list or NAME."""
    found = []
    for name, field in visible_fields(model).items():
        key = (*above, name)
        path, section = section_in(field.annotation)
        paths = [path, ("INDEX", *path)] if may_be_list(field.annotation) else [path]
        found.append(key)
        if may_be_vector(field.annotation):
            found.append((*key, "INDEX"))
        for steps in paths:
            found += [(*key, *steps[: end + 1]) for end in range(len(steps))]
            if section is not None:
                found += key_patterns(section, (*key, *steps))
    if model is MeshParameters:
        names = {name for builder in BUILDERS.values() for name in builder_types(builder)}
        found += [(*above, name) for name in sorted(names)]
    return tuple(found)


def known_keys(model: type[BaseModel], place: Sequence[str | int]) -> list[str]:
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
