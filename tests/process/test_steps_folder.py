"""The folder of a process: its files, and how a run goes on that was killed."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block
from report_folder import quick
from slow import slow

from contact_locking import InputError, Parameters, save, solve_steps, study_file
from contact_locking.monitor import Monitor
from contact_locking.results.table import Table
from contact_locking.running.run import run
from contact_locking.view import report

RUN = """
import os, signal, sys
from contact_locking import load
from contact_locking.monitor import Monitor
from contact_locking.running.run import run

class Killing(Monitor):
    def step(self, number, left, time, seconds_left):
        if number == 3:
            os.kill(os.getpid(), signal.SIGKILL)

run(load(sys.argv[1]).parameters, sys.argv[2], monitor=Killing())
"""
FILES = {
    "summary.json",
    "parameters.yaml",
    "contact.csv",
    "contact_facets.csv",
    "history.csv",
    "fields.bp",
}
# What a run measures of itself, or of rounding.
ITS_OWN = {"seconds", "tangents", "linear", "residual", "energy_defect", "nearest_criterion"}


def sheared(**changes: Any) -> Parameters:
    given: dict[str, Any] = {
        "h": 0.25,
        "loads": {
            "displacements": [{"on": "top", "value": ["0.02*sin(6*t)", "-0.02*min(4*t, 1)"]}]
        },
        "steps": {"to": 1.0, "count": 5},
        "friction__coefficient": "0.3 + 0.1*exp(-s/0.01)",
        "material__locking_limit": 0.04,
        "penalty__n": math.inf,
        "output": {"picture": False},
    }
    return block(**(given | changes))


def shared(path: Path) -> Path:
    return Path(MPI.COMM_WORLD.bcast(path))


def history_in(folder: Path) -> Table:
    return Table.read((folder / "history.csv").read_text(), "history.csv")


def assert_same(a: Table, b: Table) -> None:
    assert [*a.columns] == [*b.columns] and len(a) == len(b)
    for name in set(a.columns) - ITS_OWN:
        size = np.abs(a.column(name)).max()
        assert np.allclose(a.column(name), b.column(name), rtol=1e-6, atol=1e-7 * size + 1e-12), (
            name
        )


def test_a_tool_that_gets_behind_the_body_halves_the_step_and_leaves_the_steps_before(
    tmp_path: Path,
) -> None:
    """The centre of the tool enters the body at t = 0.6, where the way out turns round."""
    folder = shared(tmp_path)
    disc = {"sphere": {"centre": [0.5, 1.6], "radius": 0.5}, "motion": [0.0, "-t"]}
    given = block(
        h=0.5,
        loads={"displacements": [{"on": "bottom", "value": [0.0, 0.0]}]},
        material__locking_limit=math.inf,
        contact={"on": "top", "foundation": disc},
        penalty__n=math.inf,
        steps={"times": [0.5, 0.75, 1.0], "least": 0.06},
        output={"picture": False, "fields": False},
    )
    with pytest.raises(InputError, match=r"at t = 0.625 the foundation lies behind") as caught:
        run(given, folder)
    assert caught.value.key == "contact.foundation"
    assert history_in(folder).column("t") == pytest.approx([0.5, 0.5625])
    summary = json.loads((folder / "summary.json").read_text())
    assert not summary["converged"]
    assert summary["reason"].startswith("contact.foundation: at t = 0.625 the foundation lies")
    halved = [text for text in summary["warnings"] if "it is halved" in text]
    assert halved[0] == "the step to t = 0.75 takes contact.foundation too far; it is halved"
    assert len(halved) == summary["steps"]["halvings"]


class Interrupting(Monitor):
    """Stops a run as Ctrl-C does, when a step begins."""

    def __init__(self, at: int) -> None:
        self.at, self.numbers = at, []

    numbers: list[int]

    def step(self, number: int, left: int, time: float, seconds_left: float | None) -> None:
        self.numbers.append(number)
        if number == self.at:
            raise KeyboardInterrupt


@quick
@pytest.mark.serial
@pytest.mark.parametrize("fields", [slow(True), False])
def test_a_killed_run_goes_on_from_its_last_complete_step(fields: bool, tmp_path: Path) -> None:
    parameters = sheared(output={"picture": False, "fields": fields})
    file, folder = tmp_path / "study.yml", tmp_path / "out"
    file.write_text(study_file.dump(parameters))
    folder.mkdir()
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(file), str(folder)], check=False, env=environment
    )
    assert done.returncode == -9 and not (folder / "summary.json").exists()
    going_on = Interrupting(-1)
    run(parameters, folder, monitor=going_on)
    assert going_on.numbers == [3, 4, 5]
    run(parameters, tmp_path / "whole")
    assert_same(history_in(tmp_path / "whole"), history_in(folder))
    whole, cut = (
        np.genfromtxt(path / "contact.csv", delimiter=",", usecols=range(8), skip_header=1)
        for path in (tmp_path / "whole", folder)
    )
    assert np.allclose(whole, cut, rtol=1e-5, atol=1e-8)
    # The command removes what was left in staging folders.
    names = {path.name for path in folder.glob("[!.]*")}
    assert names == FILES - (set() if fields else {"fields.bp"})
    report.write(folder)
    charts = {path.stem for path in (folder / "report").glob("*.svg")}
    assert {"history-force", "history-area", "history-energy", "history-moment"} <= charts


def test_a_process_does_not_go_on_from_a_static_solution(tmp_path: Path) -> None:
    folder = shared(tmp_path)
    loads = {"displacements": [{"on": "top", "value": [0.01, -0.02]}]}
    (static,) = solve_steps(sheared(steps=None, loads=loads))
    save(static, folder)
    with pytest.raises(InputError, match="no checkpoint of a step"):
        list(solve_steps(sheared(), restart=folder))
