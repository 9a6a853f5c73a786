"""The JSON schema of a study file, by which editors complete and check one."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Iterator
from dataclasses import MISSING, fields
from typing import Any

from pydantic import BaseModel, TypeAdapter

from contact_locking.meshes import BUILDERS
from contact_locking.parameters import MeshParameters, Parameters
from contact_locking.parameters.keys import may_be_list, may_be_vector, section_in, visible_fields
from contact_locking.parameters.mesh import builder_types
from contact_locking.parameters.study import MAX_CASES
from contact_locking.parameters.wording import show

from .listing import rows

# The language servers of editors know this version best; nothing in the schema takes a later one.
_VERSION = "http://json-schema.org/draft-07/schema#"
#: Marks of `contact_locking.parameters.base.entry` that are not part of the schema, and the titles
#: that pydantic makes from the names of keys.
_INTERNAL = ("scalar", "optional", "hidden", "title")
_PLACES = {"INDEX": r"\d+", "NAME": r"[^.]+"}


def schema() -> dict[str, Any]:
    """The JSON schema of a study file; .inf is the text ".inf", as JSON has no infinity."""
    found = _json(Parameters.model_json_schema(by_alias=True))
    sections = found["$defs"]
    sections["MeshParameters"] = _json(_mesh_schema())
    sections["StudyParameters"]["properties"] |= {
        kind: {"$ref": "#/$defs/VariedKeys", "description": about["description"]}
        for kind, about in sections["StudyParameters"]["properties"].items()
    }
    for section in sections.values():
        _with_empty(section)
    sections["VariedKeys"] = _varied_keys()
    sections["VariedValues"] = _varied_values()
    head = {"$schema": _VERSION, "title": "A study file of contact-locking"}
    return head | found


def _with_empty(section: dict[str, Any]) -> None:
    """Let a section be empty, as YAML reads a key with nothing behind it, if it may have no key."""
    if section.get("type") == "object" and not section.get("required"):
        section["type"] = ["object", "null"]


def _mesh_schema() -> dict[str, Any]:
    about = visible_fields(MeshParameters)
    file = {"type": "string", "description": about["file"].description}
    told = about["axisymmetric"].description
    revolution = {"type": "boolean", "default": False, "description": told}
    kinds: list[dict[str, Any]] = [
        _object({"file": file, "axisymmetric": revolution}, required=["file"])
    ]
    for name, cls in BUILDERS.items():
        # An editor shows the description when it completes the name of the builder.
        builder = {"const": name, "default": name, "description": _first_line(cls)}
        properties: dict[str, Any] = {"builder": builder, "axisymmetric": revolution}
        types = builder_types(cls)
        for entry in fields(cls):
            kind = TypeAdapter(types[entry.name]).json_schema()
            properties[entry.name] = kind | dict(entry.metadata)
            if entry.default is not MISSING:
                properties[entry.name]["default"] = entry.default
        kinds.append(_object(properties, required=[] if name == "block" else ["builder"]))
    return {"description": MeshParameters.__doc__, "anyOf": [*kinds, {"type": "null"}]}


def _first_line(builder: type) -> str:
    return (builder.__doc__ or "").partition("\n")[0]


def _varied_keys() -> dict[str, Any]:
    """The keys that a study may vary, each with its values."""
    values = {"$ref": "#/$defs/VariedValues"}
    properties: dict[str, Any] = {}
    patterns: dict[str, Any] = {}
    for parts, description in _places(Parameters):
        key = ".".join(parts)
        if parts[0] == "study" or key == "output.directory":
            continue
        if _PLACES.keys().isdisjoint(parts):
            properties[key] = {**values, "description": description}
        else:
            patterns[_pattern(parts)] = values
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": properties,
        "patternProperties": patterns,
    }


def _places(
    model: type[BaseModel], above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], str]]:
    """All keys and entries of lists and mappings below a section, with their descriptions."""
    for name, field in visible_fields(model).items():
        key, description = (*above, name), field.description or ""
        path, section = section_in(field.annotation)
        paths = [path, ("INDEX", *path)] if may_be_list(field.annotation) else [path]
        yield key, description
        if may_be_vector(field.annotation):
            yield (*key, "INDEX"), description
        for steps in paths:
            yield from (((*key, *steps[: end + 1]), description) for end in range(len(steps)))
            if section is not None:
                yield from _places(section, (*key, *steps))
    if model is MeshParameters:
        yield from ((tuple(row.key.split(".")), row.description) for row in rows() if row.builders)


def _pattern(parts: tuple[str, ...]) -> str:
    return "^" + r"\.".join(_PLACES.get(part, re.escape(part)) for part in parts) + "$"


def _varied_values() -> dict[str, Any]:
    """A list of values, or a range as {geometric: [first, last, number of values]}."""
    number = {"type": "number"}
    count = {"type": "integer", "minimum": 2, "maximum": MAX_CASES}
    limits = {"type": "array", "items": [number, number, count], "minItems": 3, "maxItems": 3}
    ranges = [_object({kind: limits}, required=[kind]) for kind in ("geometric", "linear")]
    return {"anyOf": [{"type": "array", "minItems": 1}, *ranges]}


def _object(properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    kind = {"type": "object", "additionalProperties": False, "properties": properties}
    return kind | {"required": required} if required else kind


def _json(value: Any, names: bool = False) -> Any:
    """Plain JSON without the internal marks; ``names`` says that the keys are names of keys."""
    match value:
        case dict():
            return {
                key: _json(item, names=key == "properties" and not names)
                for key, item in value.items()
                if names or key not in _INTERNAL
            }
        case list() | tuple():
            return [_json(item) for item in value]
        case float() if not math.isfinite(value):
            return show(value)
    return copy.copy(value)
