"""The cases of a study, and the outcome of each, read from its folder: there is no other record.

A case is finished when its folder holds a complete summary of this version of the program and of
the same parameters.  `run` moves the summary into its place last, so a case is finished or not
finished, in whatever way a study is stopped.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from contact_locking import study_file
from contact_locking._version import __version__
from contact_locking.errors import InputError
from contact_locking.files import ownership
from contact_locking.files.atomic import remove_abandoned
from contact_locking.results.in_words import weakest
from contact_locking.results.names import FILES_OF_RUN, FIT, PARAMETERS, SUMMARY
from contact_locking.results.read import read_mapping
from contact_locking.study_file import StudyFile
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.telling_apart import labels


@dataclass(frozen=True)
class Case:
    """One row of a study.

    ``values`` are the values of the keys that vary, and ``label`` tells them in one line from those
    of the other cases.  ``name`` is the fingerprint of ``parameters``, and their results go to
    ``folder``.  Rows that differ only in their title share a name.  The ``command`` solves it and
    leaves the file ``record``.
    """

    values: dict[str, Any]
    label: str
    name: str
    folder: Path
    parameters: Parameters
    command: Literal["run", "fit"] = "run"

    @property
    def record(self) -> Path:
        """The file of the results that is moved into its place last."""
        return self.folder / (SUMMARY if self.command == "run" else FIT)


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


FAILURE, PROGRESS, LOG = "failure.json", "progress.json", "log.txt"
#: With Slurm, the exit code of the command that has solved a case.
EXIT_CODE = "exit_code.txt"
_BESIDE_RESULTS = (FAILURE, PROGRESS, LOG, EXIT_CODE)

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


def other_version(case: Case) -> str | None:
    """The version of the results in the folder of a case if it is another version; else None."""
    summary = read_mapping(case.record)
    if summary is None or summary.get("version") == __version__:
        return None
    return str(summary.get("version", "unknown"))


def require_own(case: Case) -> None:
    """Raise InputError if files of others stand where those of a case belong."""
    ownership.require_own(case.folder, (*FILES_OF_RUN, *_BESIDE_RESULTS), "output.directory")


def begin(case: Case) -> None:
    """Prepare the folder for `run`, and remove the files of an earlier attempt.

    Raises OSError, and InputError as `require_own`.
    """
    case.folder.mkdir(parents=True, exist_ok=True)
    remove_abandoned(case.folder)
    # A damaged summary is one of a case that is not finished.
    ownership.claim(case.folder, (*_BESIDE_RESULTS, case.record.name))
    for name in _BESIDE_RESULTS:
        (case.folder / name).unlink(missing_ok=True)
    ownership.write_text(case.folder / PARAMETERS, study_file.dump(case.parameters))


def conclude(case: Case, why: Callable[[], str]) -> Outcome:
    """The outcome of a case that has ended; ``why`` gives the reason if there are no results.

    Records the reason.  Raises OSError if this fails.
    """
    found = outcome(case)
    if found.finished:
        return found
    reason = why()
    record = {"version": __version__, "fingerprint": case.name, "reason": reason}
    text = json.dumps(record, indent=2, ensure_ascii=False) + "\n"
    ownership.write_text(case.folder / FAILURE, text)
    return Outcome("failed", reason)


def strangers(directory: Path, cases: list[Case]) -> int:
    """The number of case folders that belong to no case of the present study file."""
    known = {case.name for case in cases}
    folder = directory / "cases"
    if not folder.is_dir():
        return 0
    return sum(entry.is_dir() for entry in folder.glob("[!.]*") if entry.name not in known)


def _matches(record: dict[str, Any], case: Case) -> bool:
    return record.get("version") == __version__ and record.get("fingerprint") == case.name
