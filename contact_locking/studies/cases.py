"""The cases of a study: their parameters, and the names of the folders of their results."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contact_locking import study_file
from contact_locking.errors import InputError
from contact_locking.parameters import Parameters
from contact_locking.parameters.telling_apart import labels
from contact_locking.study_file import StudyFile


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
