"""Every key with its default, unit and description: as JSON schema and as a table."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import MISSING, fields
from typing import Any, NamedTuple

from pydantic import BaseModel, TypeAdapter

from contact_locking.meshes import BUILDERS
from contact_locking.parameters import MeshParameters, Parameters
from contact_locking.parameters.base import marks
from contact_locking.parameters.keys import section_in, visible_fields
from contact_locking.parameters.mesh import builder_types
from contact_locking.parameters.wording import show

#: Marks of `contact_locking.parameters.base.entry` that are not part of the schema.
_INTERNAL = ("scalar", "optional", "hidden")


class Row(NamedTuple):
    """A key of the study file; INDEX and NAME stand for an entry of a list or a mapping."""

    key: str
    default: str
    unit: str
    description: str


def rows(model: type[BaseModel] = Parameters, prefix: str = "") -> Iterator[Row]:
    """All keys below a section; a section stands before its own keys."""
    for name, field in visible_fields(model).items():
        key = f"{prefix}{name}"
        path, section = section_in(field.annotation)
        default = "required" if field.is_required() else _shown(field.default)
        yield Row(key, default, marks(field)["unit"], field.description or "")
        if section is not None:
            yield from rows(section, ".".join((key, *path, "")))
    if model is MeshParameters:
        yield from _builder_rows(prefix)


def _builder_rows(prefix: str) -> Iterator[Row]:
    """Parameters of the geometries. A parameter of several geometries is listed once."""
    having: dict[Row, list[str]] = {}
    for builder, cls in BUILDERS.items():
        for entry in fields(cls):
            default = "required" if entry.default is MISSING else _shown(entry.default)
            about = entry.metadata
            row = Row(f"{prefix}{entry.name}", default, about["unit"], about["description"])
            having.setdefault(row, []).append(builder)
    for row, builders in sorted(having.items(), key=lambda item: -len(item[1])):
        yield row._replace(description=f"{row.description} ({', '.join(builders)})")


def _shown(value: Any) -> str:
    return "" if isinstance(value, BaseModel) else show(value)


def schema_text() -> str:
    """The table of all keys, for a terminal."""
    table = [Row("key", "default", "unit", "description"), *rows()]
    widths = [max(len(row[column]) for row in table) for column in range(3)]
    lines = [
        "  ".join([*(f"{cell:{width}}" for cell, width in zip(row, widths, strict=False)), row[3]])
        for row in table
    ]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def schema() -> dict[str, Any]:
    """The JSON schema of a study file; .inf is the text ".inf", as JSON has no infinity."""
    result = Parameters.model_json_schema(by_alias=True)
    result["$defs"]["MeshParameters"] = _mesh_schema()
    return _json(result)


def _mesh_schema() -> dict[str, Any]:
    about = {"type": "string", "description": visible_fields(MeshParameters)["file"].description}
    kinds = [_object({"file": about}, required=["file"])]
    for name, cls in BUILDERS.items():
        properties: dict[str, Any] = {"builder": {"const": name, "default": "block"}}
        types = builder_types(cls)
        for entry in fields(cls):
            kind = TypeAdapter(types[entry.name]).json_schema()
            properties[entry.name] = kind | dict(entry.metadata)
            if entry.default is not MISSING:
                properties[entry.name]["default"] = entry.default
        kinds.append(_object(properties, required=[] if name == "block" else ["builder"]))
    return {"title": "MeshParameters", "description": MeshParameters.__doc__, "anyOf": kinds}


def _object(properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    kind = {"type": "object", "additionalProperties": False, "properties": properties}
    return kind | {"required": required} if required else kind


def _json(value: Any) -> Any:
    match value:
        case dict():
            return {key: _json(item) for key, item in value.items() if key not in _INTERNAL}
        case list() | tuple():
            return [_json(item) for item in value]
        case float() if not math.isfinite(value):
            return show(value)
    return value
