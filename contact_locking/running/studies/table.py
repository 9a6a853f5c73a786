"""The results of all cases as a table, in CSV and as JSON lines."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from contact_locking.files.csv_file import csv_text
from contact_locking.files.ownership import write_text
from contact_locking.plain_text import spreadsheet_cell
from contact_locking.results.names import TABLE_CSV, TABLE_LINES
from contact_locking.results.read import Row

from .cases import Case, Outcome

# The title may have changed since the case was solved; if it varies, it has a column of its own.
_LEFT_OUT = ("title", "fingerprint", "not_finite")


def write(directory: Path, cases: Sequence[Case], outcomes: Sequence[Outcome]) -> None:
    """Write both tables: a row per case in the order of the file. Raises OSError."""
    rows = [row(case, outcome) for case, outcome in zip(cases, outcomes, strict=True)]
    columns = list(dict.fromkeys(name for entry in rows for name in entry))
    cells = ([_cell(entry.get(name)) for name in columns] for entry in rows)
    write_text(directory / TABLE_CSV, csv_text(columns, cells))
    lines = [
        json.dumps({name: entry.get(name) for name in columns}, ensure_ascii=False, allow_nan=False)
        for entry in rows
    ]
    write_text(directory / TABLE_LINES, "".join(f"{line}\n" for line in lines))


def row(case: Case, outcome: Outcome) -> Row:
    """The values that vary, the name and state of the case, and its summary under dotted keys.

    Lists of mappings, such as the stages, are left out.  The texts "inf" and "nan" stand for
    infinity and NaN, which JSON does not have.
    """
    entry: Row = {key: _plain(value) for key, value in case.values.items()}
    entry |= {"case": case.name, "state": outcome.state}
    summary = outcome.summary or {"converged": False, "reason": outcome.reason}
    named = {key: value for key, value in summary.items() if key not in _LEFT_OUT}
    for key, value in _flat(named, ""):
        entry.setdefault(key, value)
    for key, text in summary.get("not_finite", {}).items():
        if key in entry:
            entry[key] = text
    return entry


def _flat(value: Any, key: str) -> list[tuple[str, Any]]:
    match value:
        case dict():
            below = [_flat(item, f"{key}.{name}" if key else name) for name, item in value.items()]
            return [pair for pairs in below for pair in pairs]
        case list() if all(isinstance(item, str) for item in value):
            return [(key, "; ".join(value))]
        case list() if any(isinstance(item, dict) for item in value):
            return []
        case list():
            below = [_flat(item, f"{key}.{index}") for index, item in enumerate(value)]
            return [pair for pairs in below for pair in pairs]
    return [(key, _plain(value))]


def _plain(value: Any) -> Any:
    match value:
        case float() if not math.isfinite(value):
            return str(value)
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
    return value


def _cell(value: Any) -> Any:
    match value:
        case bool() | dict() | list():
            return json.dumps(value, ensure_ascii=False)
        case str():
            return spreadsheet_cell(value)
    return value
