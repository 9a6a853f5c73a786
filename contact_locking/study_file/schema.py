"""Every key of a study file: as a table, and as a JSON schema, by which editors check a file."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from dataclasses import MISSING, fields
from itertools import groupby
from typing import Any, NamedTuple

from pydantic import TypeAdapter
from pydantic.fields import FieldInfo

from contact_locking.meshes import BUILDERS
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.problem import MeshParameters, builder_types
from contact_locking.study_file.parameters.study import MAX_CASES, sections_in, visible_fields
from contact_locking.values.concept import Concept, unit_of
from contact_locking.values.value import show


class Row(NamedTuple):
    """A key of the study file; INDEX and NAME stand for an entry of a list or a mapping.

    ``builders`` are those of the mesh that have the key; empty for a key of no builder.
    """

    key: str
    default: str
    unit: str
    description: str
    builders: tuple[str, ...] = ()

    @property
    def of(self) -> str:
        """The heading above the parameters of these builders; empty for a key of no builder."""
        if len(self.builders) == len(BUILDERS):
            return "every builder"
        return ", ".join(self.builders)


def rows() -> list[Row]:
    """All keys, each once: a section stands before its own keys.

    Where a section has the same keys as an earlier one, its description says so in their place.
    """
    return list(_rows((Parameters,), "", {}))


def schema_text() -> str:
    """The table of all keys for a terminal, a line for each."""
    table = rows()
    columns = [max(len(row[column]) for row in table) for column in range(3)]
    parts = []
    for name, members in groupby(table, key=lambda row: row.key.partition(".")[0]):
        first, *others = members
        default = f" (default: {first.default})" if first.default and not others else ""
        lines = [f"{name}: {first.description}{default}"]
        heading = ""
        for row in others:
            if row.of != heading:
                heading = row.of
                lines.append(f"  of {heading}:")
            cells = [f"{cell:{size}}" for cell, size in zip(row, columns, strict=False)]
            lines.append("  " + "  ".join([*cells, row.description]).rstrip())
        parts.append("\n".join(lines))
    head = "Keys with their defaults, units and meanings. INDEX counts from 0; NAME is a name.\n"
    return head + "\n" + "\n\n".join(parts) + "\n"


Sections = tuple[type[Concept], ...]


def _rows(models: Sections, prefix: str, known: dict[Sections, str]) -> Iterator[Row]:
    """The keys below a section, or below what is one of several sections.

    ``known`` are the sections that were listed before.
    """
    having: dict[str, list[FieldInfo]] = {}
    for model in models:
        for name, field in visible_fields(model).items():
            having.setdefault(name, []).append(field)
    for name, fields_ in having.items():
        key = f"{prefix}{name}"
        path, sections = sections_in(fields_[0].annotation)
        defaults = {"required" if info.is_required() else _shown(info.default) for info in fields_}
        default = defaults.pop() if len(defaults) == 1 else "required"
        description = "; ".join(dict.fromkeys(info.description or "" for info in fields_))
        row = Row(key, default, unit_of(fields_[0]), description)
        if sections in known:
            yield row._replace(description=f"{description}; its keys: those of {known[sections]}")
            continue
        yield row
        if sections:
            known[sections] = key
            yield from _rows(sections, ".".join((key, *path, "")), known)
    if models == (MeshParameters,):
        yield from _builder_rows(prefix)


def _builder_rows(prefix: str) -> list[Row]:
    """The parameters of the geometries, each once, those of the same builders together."""
    having: dict[str, dict[str, Row]] = {}
    for builder, cls in BUILDERS.items():
        for entry in fields(cls):
            default = "required" if entry.default is MISSING else _shown(entry.default)
            about = entry.metadata
            row = Row(f"{prefix}{entry.name}", default, about["unit"], about["description"])
            having.setdefault(entry.name, {})[builder] = row
    merged = [_merged(builders) for builders in having.values()]
    # The keys of many builders first.
    groups = sorted({row.builders: None for row in merged}, key=lambda builders: -len(builders))
    return sorted(merged, key=lambda row: groups.index(row.builders))


def _merged(having: dict[str, Row]) -> Row:
    """One row for the parameter of several builders, which names the builders that differ."""

    def merged(column: int) -> str:
        values = {builder: str(row[column]) for builder, row in having.items()}
        usual, *others = dict.fromkeys(values.values())
        exceptions = [
            f"{', '.join(builder for builder in values if values[builder] == other)}: {other}"
            for other in others
        ]
        return "; ".join([usual, *exceptions])

    first = next(iter(having.values()))
    return Row(first.key, merged(1), first.unit, merged(3), tuple(having))


def _shown(value: Any) -> str:
    return "" if isinstance(value, Concept) else show(value)


# The language servers of editors know this version best; nothing in the schema takes a later one.
_VERSION = "http://json-schema.org/draft-07/schema#"


def schema() -> dict[str, Any]:
    """The JSON schema of a study file; .inf is the text ".inf", as JSON has no infinity."""
    whole = _json(Parameters.model_json_schema(by_alias=True))
    sections = whole["$defs"]
    sections["MeshParameters"] = _json(_mesh_schema())
    sections["StudyParameters"]["properties"] |= {
        kind: {"$ref": "#/$defs/VariedKeys", "description": about["description"]}
        for kind, about in sections["StudyParameters"]["properties"].items()
    }
    for section in sections.values():
        # YAML reads a key with nothing behind it as null.
        if section.get("type") == "object" and not section.get("required"):
            section["type"] = ["object", "null"]
    values = {"$ref": "#/$defs/VariedValues"}
    sections["VariedKeys"] = {"type": "object", "additionalProperties": values}
    sections["VariedValues"] = _varied_values()
    head = {"$schema": _VERSION, "title": "A study file of contact-locking"}
    return head | whole


def _mesh_schema() -> dict[str, Any]:
    about = visible_fields(MeshParameters)
    file = {"type": "string", "description": about["file"].description}
    about_axis = about["axisymmetric"].description
    shared: dict[str, Any] = {
        "axisymmetric": {"type": "boolean", "default": False, "description": about_axis},
        "parts": {
            "type": "object",
            "additionalProperties": {"$ref": "#/$defs/BoundaryPart"},
            "default": {},
            "description": about["parts"].description,
        },
    }
    kinds: list[dict[str, Any]] = [_object({"file": file, **shared}, required=["file"])]
    for name, cls in BUILDERS.items():
        # An editor shows the description when it completes the name of the builder.
        builder = {
            "const": name,
            "default": name,
            "description": (cls.__doc__ or "").partition("\n")[0],
        }
        properties: dict[str, Any] = {"builder": builder, **shared}
        types = builder_types(cls)
        for entry in fields(cls):
            kind = TypeAdapter(types[entry.name]).json_schema()
            properties[entry.name] = kind | dict(entry.metadata)
            if entry.default is not MISSING:
                properties[entry.name]["default"] = entry.default
        kinds.append(_object(properties, required=[] if name == "block" else ["builder"]))
    return {"description": MeshParameters.__doc__, "anyOf": [*kinds, {"type": "null"}]}


def _varied_values() -> dict[str, Any]:
    number = {"type": "number"}
    count = {"type": "integer", "minimum": 2, "maximum": MAX_CASES}
    limits = {"type": "array", "items": [number, number, count], "minItems": 3, "maxItems": 3}
    ranges = [_object({kind: limits}, required=[kind]) for kind in ("geometric", "linear")]
    return {"anyOf": [{"type": "array", "minItems": 1}, *ranges]}


def _object(properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    kind = {"type": "object", "additionalProperties": False, "properties": properties}
    return kind | {"required": required} if required else kind


def _json(value: Any, names: bool = False) -> Any:
    """Plain JSON without pydantic's titles, and fields of scripts; ``names`` are those of keys."""
    match value:
        case dict():
            return {
                key: _json(entry, names=key == "properties" and not names)
                for key, entry in value.items()
                if (names or key != "title") and not key.startswith("<")
            }
        case list() | tuple():
            return [_json(entry) for entry in value]
        case float() if not math.isfinite(value):
            return show(value)
    return copy.copy(value)
