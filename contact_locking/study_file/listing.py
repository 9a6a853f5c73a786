"""Every key of a study file with its default, unit and description, as a table."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import MISSING, fields
from itertools import groupby
from typing import Any, NamedTuple

from pydantic import BaseModel

from contact_locking.meshes import BUILDERS
from contact_locking.parameters import MeshParameters, Parameters
from contact_locking.parameters.base import marks
from contact_locking.parameters.keys import section_in, visible_fields
from contact_locking.parameters.wording import show

_NARROWEST_DESCRIPTION = 30


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
    return list(_rows(Parameters, "", {}))


def schema_text(width: int = 0) -> str:
    """The table of all keys for a terminal with ``width`` columns; 0 folds no line."""
    table = rows()
    columns = [max(len(row[column]) for row in table) for column in range(3)]
    indent = 2 + sum(columns) + 2 * len(columns)
    room = max(width - indent, _NARROWEST_DESCRIPTION) if width else 0
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
            told = textwrap.wrap(row.description, room) if room else [row.description]
            lines.append("  " + "  ".join([*cells, told[0]]).rstrip())
            lines += [" " * indent + more for more in told[1:]]
        parts.append("\n".join(lines))
    head = "Keys with their defaults, units and meanings. INDEX counts from 0; NAME is a name.\n"
    return head + "\n" + "\n\n".join(parts) + "\n"


def _rows(model: type[BaseModel], prefix: str, known: dict[type[BaseModel], str]) -> Iterator[Row]:
    """The keys below a section; ``known`` are the sections that were listed before."""
    for name, field in visible_fields(model).items():
        key = f"{prefix}{name}"
        path, section = section_in(field.annotation)
        default = "required" if field.is_required() else _shown(field.default)
        row = Row(key, default, marks(field)["unit"], field.description or "")
        if section in known:
            yield row._replace(
                description=f"{row.description}; its keys: those of {known[section]}"
            )
            continue
        yield row
        if section is not None:
            known[section] = key
            yield from _rows(section, ".".join((key, *path, "")), known)
    if model is MeshParameters:
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
    order = {builders: number for number, builders in enumerate(_groups(merged))}
    return sorted(merged, key=lambda row: order[row.builders])


def _groups(table: list[Row]) -> list[tuple[str, ...]]:
    """The groups of builders that share a parameter, those of many builders first."""
    groups = dict.fromkeys(row.builders for row in table)
    return sorted(groups, key=lambda builders: -len(builders))


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
    return "" if isinstance(value, BaseModel) else show(value)
