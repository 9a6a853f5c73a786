"""Tables of studies as JSON lines: those of ``contact-locking study``, and of scripts."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from contact_locking.errors import InputError
from contact_locking.results.atomic import write_text
from contact_locking.studies.table import JSON_LINES

Row = dict[str, Any]


def write_table(directory: Path, rows: Iterable[Row]) -> None:
    """Write rows of numbers and texts to ``table.jsonl`` in ``directory``. Raises OSError."""
    directory.mkdir(parents=True, exist_ok=True)
    lines = [json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n" for row in rows]
    write_text(directory / JSON_LINES, "".join(lines))


def read_table(directory: Path) -> list[Row]:
    """The rows of a study's ``table.jsonl``.

    Raises InputError if there is none that can be read.
    """
    path = directory / JSON_LINES
    try:
        return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {error}; run its study first") from error
