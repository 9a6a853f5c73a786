"""Studies of a script: the problem of each case is made by a function, and solved here."""

from __future__ import annotations

import contextlib
import json
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking.errors import ContactLockingError, InputError, NoRoom
from contact_locking.process.loop import Process
from contact_locking.results.folder import on_root_of
from contact_locking.results.output import Output
from contact_locking.results.solution import summary_text
from contact_locking.running import run
from contact_locking.running.cases import Outcome, State, case_folder, row_of, write_rows
from contact_locking.study_file.parameters.study import StudyParameters


def solve_cases(
    make_problem: Callable[..., Any],
    cases: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    directory: str | Path | None = None,
    output: Output | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> list[dict[str, Any]]:
    """A row for each case: its values, its state, and the numbers of its solution; collective.

    The rows are those of table.csv of a study file, with the names of summary.json as dotted keys.
    The cases are solved one after the other, by all ranks together.  A case that cannot be solved
    has the state ``failed`` with the reason, and the others go on.  Raises InputError for cases
    that cannot be used, and the errors of writing.

    Parameters
    ----------
    make_problem
        ``make_problem(**values)`` returns the ContactProblem of a case, a :class:`Process`, or an
        iterator over solutions, as :func:`adapt` does, of which the last counts
    cases
        values by name, as ``{"mu": [0.1, 0.3], "n": {"geometric": [1e2, 1e6, 5]}}``: every
        combination of them; or a list of mappings, one for each case
    directory
        the folder of table.csv and table.jsonl, with the results of each case below ``cases``;
        without one there are no files
    output
        which files each case has
    """
    if isinstance(cases, Mapping):
        cases = StudyParameters(vary=dict(cases)).cases()
    rows = []
    for number, values in enumerate(cases, start=1):
        name = f"{number:04d}"
        place = None if directory is None else case_folder(Path(directory), name)
        try:
            outcome = _outcome(make_problem(**values), place, output, comm)
        except ContactLockingError as error:
            if isinstance(error, NoRoom):
                raise
            about = f"{error.key}: " if isinstance(error, InputError) and error.key else ""
            outcome = Outcome("failed", f"{about}{error}")
        rows.append(row_of(values, name, outcome))
        if directory is not None:
            on_root_of(comm, Path(directory), lambda: write_rows(Path(directory), rows))
    return rows


def _outcome(made: Any, place: Path | None, output: Output | None, comm: MPI.Intracomm) -> Outcome:
    """The outcome of a problem, or of what iterates over solutions, with its files in a folder."""
    with contextlib.ExitStack() as stack:
        owner = made.problem if isinstance(made, Process) else made
        if hasattr(owner, "close"):
            stack.callback(owner.close)
        if not hasattr(made, "solve") and place is not None:
            solution, _ = run.write_steps(made, place, output, comm=comm)
        else:
            solution = made.solve() if hasattr(made, "solve") else deque(made, maxlen=1)[0]
            if place is not None:
                run.write(solution, place, output)
        summary = json.loads(summary_text(solution.summary))
    state: State = "converged" if solution.converged else "not converged"
    return Outcome(state, str(summary["reason"]), summary)
