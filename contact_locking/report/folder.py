"""What a folder of results holds, read with the suspicion that files from anywhere deserve."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking._version import __version__
from contact_locking.errors import InputError
from contact_locking.plotting import PICTURE
from contact_locking.results.names import CONTACT, FACETS, PARAMETERS, SUMMARY
from contact_locking.solution import STATE_NAMES, ContactPoints
from contact_locking.studies.table import JSON_LINES, Row

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_MAX_BYTES = 500_000_000
_SCALARS, _VECTORS = (
    ("u_normal", "gap", "pressure", "bound"),
    ("u_tangent", "traction_tangent", "normal"),
)
_NAME = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class RunResults:
    """The folder of a run.

    ``contact`` and its ``facets`` (m, d), as numbers of the points, are None for a body without
    Gamma_C.
    """

    folder: Path
    summary: dict[str, Any]
    parameters: str
    contact: ContactPoints | None
    facets: IntArray | None
    picture: Path | None


@dataclass(frozen=True)
class StudyResults:
    """The folder of a study: the rows of its table."""

    folder: Path
    parameters: str
    rows: list[Row]

    def case_folder(self, row: Row) -> Path | None:
        """Where the results of a row are, if they are there."""
        name = row.get("case")
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            return None
        path = self.folder / "cases" / name
        return path if path.is_dir() else None


def read(folder: Path) -> RunResults | StudyResults:
    """The results in a folder. Raises InputError if there are none that this version can show."""
    if not folder.is_dir():
        there = "is no folder" if folder.exists() else "there is no such folder"
        raise InputError(f"{folder}: {there}; give the folder of a run or of a study")
    if (folder / JSON_LINES).exists():
        return _study(folder)
    if (folder / SUMMARY).exists():
        return _run(folder)
    if (folder / PARAMETERS).exists():
        raise InputError(f"{folder}: is not finished: there is no {SUMMARY}; solve it again")
    raise InputError(
        f"{folder}: holds no results: neither {SUMMARY} of a run nor {JSON_LINES} of a study"
    )


def _run(folder: Path) -> RunResults:
    path = folder / SUMMARY
    summary = _mapping(_text(path), str(path))
    _require_version(summary, folder)
    if not isinstance(summary.get("converged"), bool):
        raise InputError(f"{path}: is damaged: it does not say whether the run converged")
    for key, text in dict(_dict(summary.pop("not_finite", None))).items():
        _restore(summary, key.split("."), text)
    picture = folder / PICTURE
    contact = _contact(folder / CONTACT)
    return RunResults(
        folder,
        summary,
        _text(folder / PARAMETERS),
        contact,
        None if contact is None else _facets(folder / FACETS, contact),
        picture if picture.is_file() else None,
    )


def _study(folder: Path) -> StudyResults:
    path = folder / JSON_LINES
    rows = [
        _mapping(line, f"{path}:{number}")
        for number, line in enumerate(_text(path).split("\n"), start=1)
        if line
    ]
    if not rows:
        raise InputError(f"{path}: is empty; run the study again")
    for row in rows:
        if row.get("version") is not None:
            _require_version(row, folder)
        if not isinstance(row.get("state"), str):
            raise InputError(f"{path}: is damaged: a row does not say the state of its case")
    if all(row["state"] == "not run" for row in rows):
        raise InputError(f"{folder}: no case of the study is finished; go on with the study first")
    return StudyResults(folder, _text(folder / PARAMETERS), rows)


def _contact(path: Path) -> ContactPoints | None:
    header, rows = _table(path)
    if not rows:
        return None
    axes = [name for name in "xyz" if name in header]
    vectors = {kind: [f"{kind}_{axis}" for axis in axes] for kind in _VECTORS}
    wanted = [*axes, *_SCALARS, *(name for names in vectors.values() for name in names), "state"]
    missing = [name for name in wanted if name not in header]
    if missing or not 2 <= len(axes) <= 3:
        raise InputError(f"{path}:1: is damaged: there is no column {', '.join(missing or 'xy')}")
    place = {name: header.index(name) for name in wanted}
    numbers = np.empty((len(rows), len(wanted) - 1))
    states = np.empty(len(rows), dtype=np.int64)
    for index, (line, cells) in enumerate(rows):
        try:
            numbers[index] = [float(cells[place[name]]) for name in wanted[:-1]]
            states[index] = STATE_NAMES.index(cells[place["state"]])
        except (ValueError, IndexError):
            raise InputError(f"{path}:{line}: is damaged: no row of {len(header)} values") from None
    if not np.isfinite(numbers).all():
        line = rows[int(np.argmin(np.isfinite(numbers).all(axis=1)))][0]
        raise InputError(f"{path}:{line}: holds a value that is not finite")
    columns = dict(zip(wanted, numbers.T, strict=False))

    def vector(names: list[str]) -> FloatArray:
        return np.column_stack([columns[name] for name in names])

    return ContactPoints(
        x=vector(axes),
        normal=vector(vectors["normal"]),
        u_normal=columns["u_normal"],
        u_tangent=vector(vectors["u_tangent"]),
        gap=columns["gap"],
        pressure=columns["pressure"],
        traction=vector(vectors["traction_tangent"]),
        bound=columns["bound"],
        state=states,
    )


def _facets(path: Path, contact: ContactPoints) -> IntArray:
    rows = _table(path)[1]
    facets = np.empty((len(rows), contact.dim), dtype=np.int64)
    for index, (line, cells) in enumerate(rows):
        try:
            facets[index] = [int(cell) for cell in cells]
        except (ValueError, OverflowError):
            raise InputError(f"{path}:{line}: is damaged: no {contact.dim} numbers") from None
    if facets.size and not 0 <= facets.min() <= facets.max() < len(contact.x):
        raise InputError(f"{path}: is damaged: it names points that are not in {CONTACT}")
    return facets


def _table(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The header, and the rows with their lines."""
    lines = list(_csv(path))
    if not lines:
        raise InputError(f"{path}: is empty; solve the run again")
    return lines[0][1], lines[1:]


def _csv(path: Path) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(io.StringIO(_text(path), newline=""))
    try:
        for cells in reader:
            yield reader.line_num, cells
    except csv.Error as error:
        raise InputError(f"{path}:{reader.line_num}: is damaged: {error}") from None


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: is too large to be a result")
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{path}: is damaged: no text in UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _mapping(text: str, name: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError(f"{name}: is damaged: no JSON") from None
    if not isinstance(content, dict):
        raise InputError(f"{name}: is damaged: no mapping of names to values")
    return content


def _require_version(record: dict[str, Any], folder: Path) -> None:
    if (version := record.get("version")) != __version__:
        raise InputError(
            f"{folder}: holds results of version {version}, and this is {__version__}; "
            "use that version for them, or solve again"
        )


def _restore(value: Any, path: list[str], text: Any) -> None:
    """Put the number back that JSON cannot hold."""
    *above, last = path
    for name in above:
        value = _item(value, name)
    if text in ("inf", "-inf", "nan") and _item(value, last) is None:
        match value:
            case dict():
                value[last] = float(text)
            case list() if last.isdecimal() and int(last) < len(value):
                value[int(last)] = float(text)


def _item(value: Any, name: str) -> Any:
    match value:
        case dict():
            return value.get(name)
        case list() if name.isdecimal() and int(name) < len(value):
            return value[int(name)]
    return None


def _dict(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def number(value: Any) -> float | None:
    """A number of a table, in which infinity is a text; None for anything else."""
    if isinstance(value, bool) or value is None:
        return None
    if isinstance(value, int | float) or value in ("inf", "-inf"):
        try:
            found = float(value)
        except OverflowError:
            return None
        return None if math.isnan(found) else found
    return None
