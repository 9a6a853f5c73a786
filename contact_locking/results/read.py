"""The results in the folder of a run or of a study; every file is checked."""

from __future__ import annotations

import contextlib
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contact_locking._version import __version__
from contact_locking.arrays import IntArray
from contact_locking.errors import InputError
from contact_locking.results import contact_table, names
from contact_locking.results.contact_points import ContactPoints
from contact_locking.results.history import History, read_history
from contact_locking.results.quantities import look_up

Row = dict[str, Any]

_NAME = re.compile(r"[0-9a-f]{16}")


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
    history: History
    meshes: Path | None = None
    fit: dict[str, Any] | None = None


@dataclass(frozen=True)
class StudyResults:
    """The results of a study: a row for each case."""

    folder: Path
    parameters: str
    rows: list[Row]

    def case_folder(self, row: Row) -> Path | None:
        """The folder with the results of a row; None without such a folder."""
        name = row.get("case")
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            return None
        path = self.folder / "cases" / name
        return path if path.is_dir() else None


def read_all(folder: Path) -> list[RunResults | StudyResults]:
    """The results in a folder: of a run, of a study, or of both in this order.

    Raises InputError if the folder has no results, or results of another version.
    """
    if not folder.is_dir():
        there = "is no folder" if folder.exists() else "there is no such folder"
        raise InputError(f"{folder}: {there}; give the folder of a run or of a study")
    found: list[RunResults | StudyResults] = []
    if (folder / names.SUMMARY).exists():
        found.append(_run(folder))
    if (folder / names.TABLE_LINES).exists():
        found.append(_study(folder))
    if found:
        return found
    if (folder / names.PARAMETERS).exists():
        raise InputError(f"{folder}: is not finished: there is no {names.SUMMARY}; solve it again")
    raise InputError(
        f"{folder}: holds no results: neither {names.SUMMARY} of a run nor {names.TABLE_LINES} "
        "of a study"
    )


def read_rows(path: Path) -> list[Row]:
    """The rows of a table in JSON lines. Raises InputError if it is damaged or has no rows."""
    lines = enumerate(_text(path).split("\n"), start=1)
    rows = [_mapping(line, f"{path}:{number}") for number, line in lines if line]
    if not rows:
        raise InputError(f"{path}: is empty; run the study again")
    return rows


def read_mapping(path: Path) -> dict[str, Any] | None:
    """The mapping in a JSON file; None if the file is missing or damaged."""
    try:
        return _mapping(_text(path), str(path))
    except InputError:
        return None


def history_in(folder: Path) -> History | None:
    """The steps of the run in a folder; None without steps."""
    path = folder / names.HISTORY
    return read_history(_text(path), str(path)) if path.is_file() else None


def _run(folder: Path) -> RunResults:
    path = folder / names.SUMMARY
    summary = _mapping(_text(path), str(path))
    _require_version(summary, folder)
    if not isinstance(summary.get("converged"), bool):
        raise InputError(f"{path}: is damaged: it does not say whether the run converged")
    listed = summary.pop("not_finite", None)
    for key, text in listed.items() if isinstance(listed, dict) else ():
        _restore(summary, key, text)
    picture, meshes = folder / names.PICTURE, folder / names.MESHES
    contact, facets = folder / names.CONTACT, folder / names.FACETS
    points = contact_table.read_points(_text(contact), str(contact))
    return RunResults(
        folder,
        summary,
        _text(folder / names.PARAMETERS),
        points,
        contact_table.read_facets(_text(facets), str(facets), points),
        picture if picture.is_file() else None,
        history_in(folder) or History(),
        meshes if meshes.is_file() else None,
        read_mapping(folder / names.FIT),
    )


def _study(folder: Path) -> StudyResults:
    path = folder / names.TABLE_LINES
    rows = read_rows(path)
    for row in rows:
        if row.get("version") is not None:
            _require_version(row, folder)
        if not isinstance(row.get("state"), str):
            raise InputError(f"{path}: is damaged: a row does not say the state of its case")
    if all(row["state"] == "not run" for row in rows):
        raise InputError(f"{folder}: no case of the study is finished; go on with the study first")
    return StudyResults(folder, _text(folder / names.PARAMETERS), rows)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{path}: is damaged: it is not text in UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _mapping(text: str, name: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError(f"{name}: is damaged: it is not JSON") from None
    if not isinstance(content, dict):
        raise InputError(f"{name}: is damaged: it is not a mapping of names to values")
    return content


def _require_version(record: dict[str, Any], folder: Path) -> None:
    if (version := record.get("version")) != __version__:
        raise InputError(
            f"{folder}: holds results of version {version}, and this is {__version__}; "
            "use that version for them, or solve again"
        )


def _restore(summary: dict[str, Any], key: str, text: Any) -> None:
    """Set the value of a dotted key to an infinity or NaN, which JSON cannot hold."""
    above, _, last = key.rpartition(".")
    place = look_up(summary, above) if above else summary
    with contextlib.suppress(LookupError, TypeError, ValueError):
        name: Any = int(last) if isinstance(place, list) else last
        if text in ("inf", "-inf", "nan") and place[name] is None:
            place[name] = float(text)


def number(value: Any) -> float | None:
    """The number in a cell of a table, where infinity is a text; None for other values."""
    if isinstance(value, bool) or not (isinstance(value, int | float) or value in ("inf", "-inf")):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return None if math.isnan(found) else found
