"""The cases of a study, the outcome of each, read from its folder, and the table of all.

A case is finished when its folder holds a complete summary of this version of the program and of
the same parameters.  `run` moves the summary into its place last, so a case is finished or not
finished, in whatever way a study is stopped.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from contact_locking import study_file
from contact_locking._version import __version__
from contact_locking.errors import InputError
from contact_locking.files import remove_abandoned, write_text
from contact_locking.plain_text import spreadsheet_cell
from contact_locking.results.in_words import weakest
from contact_locking.results.output import PARAMETERS, SUMMARY, TABLE_CSV, TABLE_LINES
from contact_locking.results.quantities import by_name
from contact_locking.results.table import Table
from contact_locking.study_file import StudyFile
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.wording import labels


@dataclass(frozen=True)
class Case:
    """One row of a study.

    ``values`` are the values of the keys that vary, and ``label`` tells them in one line from those
    of the other cases.  ``name`` is the fingerprint of ``parameters``, and their results go to
    ``folder``.  Rows that differ only in their title share a name.
    """

    values: dict[str, Any]
    label: str
    name: str
    folder: Path
    parameters: Parameters

    @property
    def record(self) -> Path:
        """The file of the results that is moved into its place last."""
        return self.folder / SUMMARY


def cases_of(study: StudyFile) -> list[Case]:
    """All cases of a study file, in its order.

    Raises InputError for a file without a study and for a mesh file that cannot be read.
    """
    parameters = study.parameters
    if parameters.study is None:
        raise InputError(
            f"{study.source.name}: has no study; give the keys to vary, such as\n"
            "study: {vary: {penalty.n: [1.0e2, 1.0e4, .inf]}}\nor solve it with run"
        )
    digest = functools.cache(study_file.file_digest)
    directory = Path(parameters.output.directory)
    rows = parameters.study.cases()
    return [
        _case(study.case(values), values, label, directory, digest)
        for values, label in zip(rows, labels(rows), strict=True)
    ]


def each_once(cases: Iterable[Case]) -> list[Case]:
    """The cases to be solved: one for each name."""
    return list({case.name: case for case in reversed(list(cases))}.values())[::-1]


def case_folder(directory: Path, name: str) -> Path:
    """The folder of a case, below the folder of its study."""
    return directory / "cases" / name


def _case(
    parameters: Parameters, values: dict[str, Any], label: str, directory: Path, digest: Any
) -> Case:
    try:
        name = study_file.fingerprint(parameters, digest)
    except OSError as error:
        message = f"cannot be read: {error.filename}: {error.strerror}"
        tables = parameters.tables or {}
        paths = {table.file: f"tables.{key}.file" for key, table in tables.items()}
        for contact in parameters.contacts:
            if contact.foundation is not None and contact.foundation.file is not None:
                paths[contact.foundation.file] = f"{contact.key}.foundation"
        raise InputError(message, paths.get(str(error.filename), "mesh.file")) from error
    folder = case_folder(directory, name)
    output = parameters.output.model_copy(update={"directory": str(folder)})
    return Case(values, label, name, folder, parameters.model_copy(update={"output": output}))


FAILURE, LOG = "failure.json", "log.txt"

State = Literal["converged", "not converged", "failed", "not run"]


@dataclass(frozen=True)
class Outcome:
    """The state of a case; ``summary`` is None if the case is not finished."""

    state: State
    reason: str = ""
    summary: dict[str, Any] | None = None

    @property
    def finished(self) -> bool:
        """Whether the case needs no further solve."""
        return self.summary is not None

    @property
    def reservation(self) -> str:
        """The reason why a converged result is rough; otherwise empty."""
        weak = weakest(self.summary or {})
        return f", but rough: {weak.words}" if weak is not None and weak.is_rough else ""

    @property
    def warnings(self) -> list[str]:
        listed = (self.summary or {}).get("warnings")
        return [str(text) for text in listed] if isinstance(listed, list) else []


def read_mapping(path: Path) -> dict[str, Any] | None:
    """The mapping in a JSON file; None if the file is missing or damaged."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def outcome(case: Case) -> Outcome:
    """The outcome of a case as its folder has it."""
    summary = read_mapping(case.record)
    if summary is not None and _matches(summary, case):
        converged = summary.get("converged") is True
        state: State = "converged" if converged else "not converged"
        return Outcome(state, str(summary.get("reason", "")), summary)
    failure = read_mapping(case.folder / FAILURE)
    if failure is not None and _matches(failure, case):
        return Outcome("failed", str(failure.get("reason", "")))
    return Outcome("not run")


def begin(case: Case) -> None:
    """Prepare the folder for `run`, and remove the files of an earlier attempt.  Raises OSError."""
    case.folder.mkdir(parents=True, exist_ok=True)
    remove_abandoned(case.folder)
    for name in (FAILURE, LOG):
        (case.folder / name).unlink(missing_ok=True)
    write_text(case.folder / PARAMETERS, study_file.dump(case.parameters))


def conclude(case: Case, why: Callable[[], str]) -> Outcome:
    """The outcome of a case that has ended; ``why`` gives the reason if there are no results.

    Records the reason.  Raises OSError if this fails.
    """
    result = outcome(case)
    if result.finished:
        return result
    reason = why()
    record = {"version": __version__, "fingerprint": case.name, "reason": reason}
    text = json.dumps(record, indent=2, ensure_ascii=False) + "\n"
    write_text(case.folder / FAILURE, text)
    return Outcome("failed", reason)


def _matches(record: dict[str, Any], case: Case) -> bool:
    return record.get("version") == __version__ and record.get("fingerprint") == case.name


# The title may have changed since the case was solved; if it varies, it has a column of its own.
_LEFT_OUT = ("title", "fingerprint", "not_finite")


def write_rows(directory: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write both tables.  Raises OSError."""
    columns = list(dict.fromkeys(name for entry in rows for name in entry))
    cells = Table({name: [_cell(entry.get(name)) for entry in rows] for name in columns})
    write_text(directory / TABLE_CSV, cells.text())
    lines = [
        json.dumps({name: entry.get(name) for name in columns}, ensure_ascii=False, allow_nan=False)
        for entry in rows
    ]
    write_text(directory / TABLE_LINES, "".join(f"{line}\n" for line in lines))


def row_of(values: Mapping[str, Any], name: str, outcome: Outcome) -> dict[str, Any]:
    """The values that vary, the name and state of a case, and its summary under dotted keys.

    Lists of mappings go by their names, and those without names, such as the stages, are left out.
    Contacts are listed if there are several, as the summary has the numbers of one itself.  The
    texts "inf" and "nan" stand for infinity and NaN, which JSON does not have.
    """
    entry = {key: _plain(value) for key, value in values.items()}
    entry |= {"case": name, "state": outcome.state}
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
            below = [
                _flat(element, f"{key}.{name}" if key else name) for name, element in value.items()
            ]
            return [pair for pairs in below for pair in pairs]
        case list() if all(isinstance(element, str) for element in value):
            return [(key, "; ".join(value))]
        case list() if any(isinstance(element, dict) for element in value):
            named = by_name(value)
            return _flat(named, key) if len(named) > 1 else []
        case list():
            below = [_flat(element, f"{key}.{index}") for index, element in enumerate(value)]
            return [pair for pairs in below for pair in pairs]
    return [(key, _plain(value))]


def _plain(value: Any) -> Any:
    match value:
        case float() if not math.isfinite(value):
            return str(value)
        case dict():
            return {key: _plain(element) for key, element in value.items()}
        case list() | tuple():
            return [_plain(element) for element in value]
    return value


def _cell(value: Any) -> Any:
    match value:
        case bool() | dict() | list():
            return json.dumps(value, ensure_ascii=False)
        case str():
            return spreadsheet_cell(value)
    return value
