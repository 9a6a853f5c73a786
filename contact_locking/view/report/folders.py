"""The results in the folder of a run or of a study, as they were written."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from contact_locking._version import __version__
from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.results import output as names
from contact_locking.results.contact_points import ContactPoints
from contact_locking.results.quantities import look_up
from contact_locking.results.table import Table
from contact_locking.running.cases import case_folder, read_mapping

Row = dict[str, Any]


@dataclass(frozen=True)
class RunResults:
    """The results of a run; ``facets`` (m, d) number the points of ``contact``.

    ``history`` has the steps of a process, and is empty without steps.  ``fit`` is fit.json.
    """

    folder: Path
    summary: dict[str, Any]
    parameters: str
    contact: ContactPoints
    facets: IntArray
    picture: Path | None
    history: Table
    fit: dict[str, Any] | None = None


@dataclass(frozen=True)
class StudyResults:
    """The results of a study: a row for each case."""

    folder: Path
    parameters: str
    rows: list[Row]

    def case_folder(self, row: Row) -> Path | None:
        """The folder with the results of a row; None without such a folder."""
        path = case_folder(self.folder, str(row.get("case")))
        return path if path.is_dir() else None


def read_all(folder: Path) -> list[RunResults | StudyResults]:
    """The results in a folder: of a run, of a study, or of both in this order.

    Raises InputError if the folder has no results, or those of another version.
    """
    if not folder.is_dir():
        problem = "is no folder" if folder.exists() else "there is no such folder"
        raise InputError(f"{folder}: {problem}; give the folder of a run or of a study")
    results: list[RunResults | StudyResults] = []
    if (folder / names.SUMMARY).exists():
        results.append(_run(folder))
    if (folder / names.TABLE_LINES).exists():
        results.append(_study(folder))
    if not results:
        raise InputError(
            f"{folder}: holds no results: neither {names.SUMMARY} of a finished run nor "
            f"{names.TABLE_LINES} of a study"
        )
    return results


def read_rows(path: Path) -> list[Row]:
    """The rows of a table in JSON lines."""
    return [dict(json.loads(line)) for line in path.read_text("utf-8").split("\n") if line]


def history_in(folder: Path) -> Table | None:
    """The steps of the run in a folder; None without steps."""
    path = folder / names.HISTORY
    return Table.read(path.read_text("utf-8"), str(path)) if path.is_file() else None


def _run(folder: Path) -> RunResults:
    summary = dict(json.loads((folder / names.SUMMARY).read_text("utf-8")))
    _require_version(summary, folder)
    for key, text in summary.pop("not_finite", {}).items():
        _restore(summary, key, float(text))
    contact, facets, picture = (
        folder / name for name in (names.CONTACT, names.FACETS, names.PICTURE)
    )
    corners = Table.read(facets.read_text("utf-8"), str(facets))
    return RunResults(
        folder,
        summary,
        (folder / names.PARAMETERS).read_text("utf-8"),
        ContactPoints.of(Table.read(contact.read_text("utf-8"), str(contact), ["state"])),
        np.column_stack([corners.whole(name) for name in corners.columns]),
        picture if picture.is_file() else None,
        history_in(folder) or Table(),
        read_mapping(folder / names.FIT),
    )


def _study(folder: Path) -> StudyResults:
    rows = read_rows(folder / names.TABLE_LINES)
    for row in rows:
        if row.get("version") is not None:
            _require_version(row, folder)
    if {row["state"] for row in rows} <= {"not run"}:
        raise InputError(f"{folder}: no case of the study is finished; go on with the study first")
    return StudyResults(folder, (folder / names.PARAMETERS).read_text("utf-8"), rows)


def _require_version(record: dict[str, Any], folder: Path) -> None:
    if (version := record.get("version")) != __version__:
        raise InputError(
            f"{folder}: holds results of version {version}, and this is {__version__}; "
            "use that version for them, or solve again"
        )


def _restore(summary: dict[str, Any], key: str, value: float) -> None:
    """Set the value of a dotted key to an infinity or NaN, which JSON cannot hold."""
    above, _, last = key.rpartition(".")
    place: Any = look_up(summary, above) if above else summary
    place[int(last) if isinstance(place, list) else last] = value
