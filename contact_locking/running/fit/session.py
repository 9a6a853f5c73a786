"""A fit from the study file to its results."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking import study_file
from contact_locking._version import __version__
from contact_locking.errors import InputError
from contact_locking.files import atomic, ownership
from contact_locking.monitor import Monitor
from contact_locking.parallel import on_root
from contact_locking.plain_text import count
from contact_locking.process.solving import solve
from contact_locking.results.names import FIT, FIT_PICTURE
from contact_locking.results.output_folder import KEY, on_root_of, reserved
from contact_locking.results.solution import StudySolution, summary_text
from contact_locking.running import writing
from contact_locking.running.process import run_steps
from contact_locking.study_file.parameters import Parameters

from .curves import read_experiments
from .estimate import Estimate
from .model import Model
from .search import Search
from .starts import Begun, variables_of


def fit(
    parameters: Parameters,
    directory: str | Path,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    begun: Begun | None = None,
) -> tuple[dict[str, Any], StudySolution]:
    """Fit numbers of a study file to its curves: the content of fit.json, and the last solution.

    ``directory`` gets the run at the numbers that were found, fit.json and fit.png; the runs of
    further experiments are in folders below it with the names of their files.  Evaluations stay in
    ``directory``/evaluations, where a fit that was ended finds them.  ``begun`` is the best of
    several searches, whose evaluations are found again.  Collective.  Raises InputError for data
    or keys that cannot be used, and NotConverged without a solution at the start.
    """
    monitor, target = monitor or Monitor(), Path(directory)
    if parameters.fit is not None and parameters.fit.starts > 1:
        raise InputError("several searches take the command contact-locking fit", "fit.starts")
    experiments = on_root(comm, partial(read_experiments, parameters))
    variables = variables_of(parameters)
    others = () if begun is None else (begun.folder,)
    model = Model(parameters, experiments, (target, *others), comm)
    search = Search(model, variables, monitor)
    for one in experiments:
        for name in one.unused:
            monitor.message(f"warning: {one.path}: the column {name[:60]!r} is not used")
    found = search.run()
    solution = _final_runs(model, found, target, comm, monitor)
    fingerprint = on_root(comm, partial(study_file.fit_fingerprint, parameters))
    content = search.content(found, [] if begun is None else begun.rows)
    content |= {"version": __version__, "fingerprint": fingerprint}
    problem = on_root_of(comm, target, partial(_write, target, content))
    if problem:
        monitor.message(f"warning: {problem}")
    return content, solution


def _final_runs(
    model: Model, found: Estimate, target: Path, comm: MPI.Intracomm, monitor: Monitor
) -> StudySolution:
    """Run each experiment at the numbers that were found; collective."""
    first: StudySolution | None = None
    last_cases = {id(case.experiment): case for case in model.cases}
    several = len(last_cases)
    if several > 1:
        monitor.message(f"the runs of {count(several, 'experiment')}")
    for number, case in enumerate(last_cases.values()):
        folder = target if number == 0 else target / f"{number}-{case.experiment.path.stem}"
        given = model.parameters
        wanted = model.case_parameters(case, list(map(float, found.numbers))).model_copy(
            update={"sensitivities": given.sensitivities}
        )
        if number == 0:
            first = _run(wanted, folder, comm, monitor)
            continue
        with reserved(folder, comm):
            _run(wanted, folder, comm, monitor)
    assert first is not None
    return first


def _run(
    parameters: Parameters, folder: Path, comm: MPI.Intracomm, monitor: Monitor
) -> StudySolution:
    if parameters.steps is not None:
        return run_steps(parameters, folder, comm, monitor)[0]
    solution = solve(parameters, comm, monitor)
    writing.write(solution, folder)
    return solution


def _write(target: Path, content: dict[str, Any]) -> str | None:
    """Write fit.json and fit.png; why there is no picture."""
    problem = None
    with atomic.staging(target) as made:
        (made / FIT).write_text(summary_text(content), encoding="utf-8")
        try:
            from contact_locking.extras.report.run_charts import fit_chart

            (made / FIT_PICTURE).write_bytes(fit_chart(content).png)
        except ImportError as error:
            problem = f"no picture of the fit was drawn: {error.name} cannot be imported"
        ownership.replace(target, made, (FIT, FIT_PICTURE), KEY)
    return problem
