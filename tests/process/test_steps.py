"""Processes: steps that solve the problem at several times, with friction that remembers."""

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
from problems import all_of, block, column, sheared
from report_folder import quick
from slow import slow

from contact_locking import InputError, Parameters, save, solve, solve_steps, study_file
from contact_locking.certificate import balances as energy
from contact_locking.results.table import Table
from contact_locking.running.run import run
from contact_locking.solver.monitor import Monitor
from contact_locking.view import report


@pytest.mark.serial
@pytest.mark.parametrize("n", [1e3, math.inf])
def test_one_step_from_rest_is_the_static_problem_to_the_last_digit(n: float) -> None:
    static = solve(block(h=0.25, penalty__n=n))
    loads = {
        "tractions": [{"on": "top", "value": [0.03, -0.05]}],
        "displacements": [{"on": "left", "value": ["0*t", 0]}],
    }
    step = solve(block(h=0.25, penalty__n=n, loads=loads, steps={"times": [1.0]}))
    assert np.array_equal(step.displacement.x.array, static.displacement.x.array)
    assert step.summary["iterations"] == static.summary["iterations"]
    assert step.summary["bounds"] == static.summary["bounds"]


@pytest.mark.serial
def test_the_loads_of_a_step_are_those_of_its_time() -> None:
    pull = ["0.03*t", "-0.05*t**2"]
    loads = {
        "tractions": [{"on": "top", "value": pull}],
        "body_force": ["0.01*t*x", 0],
        "displacements": [{"on": "left", "value": ["0.001*t*y", 0]}],
    }
    changes: dict[str, Any] = {"h": 0.5, "friction__coefficient": 0.0}
    moving = all_of(
        block(**changes, contact__gap="0.01*t*x", loads=loads, steps={"times": [0.5, 1.0]})
    )
    for time, found in zip((0.5, 1.0), moving, strict=True):
        fixed = {
            "tractions": [{"on": "top", "value": [0.03 * time, -0.05 * time**2]}],
            "body_force": [f"{0.01 * time}*x", 0],
            "displacements": [{"on": "left", "value": [f"{0.001 * time}*y", 0]}],
        }
        static = solve(block(**changes, contact__gap=f"{0.01 * time}*x", loads=fixed))
        u, w = found.displacement.x.array, static.displacement.x.array
        assert np.abs(u - w).max() <= 1e-7 * np.abs(w).max()
        assert found.time == time


@pytest.mark.serial
@pytest.mark.parametrize(
    ("smoothing", "coefficient"),
    [
        ({"kernel": "convolution", "radius": 0.3}, 0.3),
        ({"kernel": "helmholtz", "radius": 0.3}, "0.2 + 0.2*exp(-s/0.02)"),
        ({"kernel": "none"}, 0.3),
    ],
)
def test_newton_and_the_interior_point_method_go_the_same_way(
    smoothing: dict[str, Any], coefficient: float | str
) -> None:
    law = {"coefficient": coefficient, "smoothing": smoothing}
    ends = [
        all_of(sheared(4, friction=law, penalty__n=1e3, solver__method=method))[-1]
        for method in ("penalty", "interior_point")
    ]
    u, w = (found.displacement.x.array for found in ends)
    assert np.abs(u - w).max() <= 1e-6 * np.abs(w).max()
    slips = [found.contacts[0].slip for found in ends]
    assert np.abs(slips[0] - slips[1]).max(initial=0.0) <= 1e-7


@pytest.mark.serial
def test_friction_remembers_where_it_stood() -> None:
    slide = {"displacements": [{"on": "top", "value": ["0.1*min(t, 2 - t)", -0.02]}]}
    given: dict[str, Any] = {"loads": slide, "material__locking_limit": math.inf}
    found = all_of(sheared(2, to=2.0, **given))
    force = found[-1].history.column("friction_force_x")
    most = 0.3 * found[-1].history.column("contact_force_y")
    # The block slides all along to the right, and then back to where it started.
    assert force == pytest.approx([-most[0], most[1]], rel=1e-6)
    slips = [solution.contacts[0].slip for solution in found]
    assert np.all(slips[1] > slips[0]) and np.all(slips[0] > 0.0)
    # Without a memory there is no force but what the sides draw in, which is symmetric.
    static = {"displacements": [{"on": "top", "value": [0.0, -0.02]}]}
    nothing = solve(sheared(**{**given, "loads": static, "steps": None}))
    assert abs(nothing.summary["friction_force"][0]) < 0.1 * most[1]


def test_several_contacts_remember_on_their_own() -> None:
    contacts = [
        {"on": "bottom"},
        {"on": "right", "gap": "0.002 - 0.004*t", "friction": {"coefficient": 0.1}},
    ]
    found = all_of(
        sheared(
            3,
            loads={"displacements": [{"on": "top", "value": ["0.01*t", "-0.02*t"]}]},
            contact=contacts,
            friction={"coefficient": 0.3, "smoothing": {"radius": 0.3}},
        )
    )
    row = found[-1].history.rows[-1]
    total = row["contact_force_bottom_x"] + row["contact_force_right_x"]
    assert total == pytest.approx(row["contact_force_x"]) and row["contact_force_right_x"] < 0.0
    for fields in found[-1].contacts:
        assert np.all(fields.slip >= np.linalg.norm(fields.increment, axis=1))


@pytest.mark.serial
@pytest.mark.parametrize("n", [1e3, math.inf])
def test_the_work_of_the_loads_is_stored_dissipated_or_lost_by_the_method(n: float) -> None:
    def history(count: int) -> Any:
        return all_of(sheared(count, penalty__n=n))[-1].history

    coarse, fine = history(4), history(12)
    for found in (coarse, fine):
        assert np.all(found.column("energy_defect") <= 1e-6)
        assert np.all(found.column("numerical") >= -1e-9 * found.column("stored"))
        spent = found.column("stored") + found.column("dissipated_total")
        rest = found.column("work_total") - spent - found.column("numerical_total")
        assert np.abs(rest).max() <= 1e-12 * found.column("work_total").max()
    assert fine.last("numerical_total") < 0.6 * coarse.last("numerical_total")


@pytest.mark.serial
def test_the_energy_balance_notices_friction_that_adds_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    friction_work = energy._friction_work
    monkeypatch.setattr(energy, "_friction_work", lambda *given: 1.5 * friction_work(*given))
    found = list(solve_steps(sheared(4)))[-1]
    assert not found.converged and "energy that a step creates or loses" in found.summary["reason"]


def test_results_do_not_depend_on_the_number_of_ranks() -> None:
    parameters = sheared(4)
    together = all_of(parameters)[-1].history
    *_, last = solve_steps(parameters, MPI.COMM_SELF)
    for name in set(together.columns) - {"seconds", "linear", "residual", "tangents"}:
        if name not in ("energy_defect", "nearest_criterion"):
            mine, other = together.column(name), last.history.column(name)
            assert np.allclose(mine, other, rtol=1e-5, atol=1e-6 * np.abs(mine).max() + 1e-9), name


RUN = """
import os, signal, sys
from contact_locking import load
from contact_locking.solver.monitor import Monitor
from contact_locking.running.run import run

class Killing(Monitor):
    def step(self, number, left, time):
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
    "fields.vtkhdf",
}
# What a run measures of itself, or of rounding.
ITS_OWN = {"seconds", "tangents", "linear", "residual", "energy_defect", "nearest_criterion"}


def slid(**changes: Any) -> Parameters:
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

    def step(self, number: int, left: int, time: float) -> None:
        self.numbers.append(number)
        if number == self.at:
            raise KeyboardInterrupt


@quick
@pytest.mark.serial
@pytest.mark.parametrize("fields", [slow(True), False])
def test_a_killed_run_goes_on_from_its_last_complete_step(fields: bool, tmp_path: Path) -> None:
    parameters = slid(output={"picture": False, "fields": fields})
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
    assert names == FILES - (set() if fields else {"fields.vtkhdf"})
    report.write(folder)
    charts = {path.stem for path in (folder / "report").glob("*.svg")}
    assert {"history-force", "history-area", "history-energy", "history-moment"} <= charts


@pytest.mark.parametrize(
    "changes",
    [
        {"penalty__n": 1e4},
        {"material__elasticity": {"young": 2.0, "poisson": 0.3}},
        {"material__locking_limit": 0.03},
        {"friction__coefficient": 0.15},
        {},
    ],
)
def test_a_process_that_goes_on_with_other_data_balances_the_steps_after_the_first(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    folder = shared(tmp_path)
    save(all_of(sheared(4, 0.5))[2], folder)
    old, first, second = solve_steps(sheared(5, 0.625, **changes), restart=folder)
    assert first.converged and second.converged
    assert old.converged == (not changes)
    defects = second.history.column("energy_defect")
    assert np.flatnonzero(np.isnan(defects)).tolist() == ([3] if changes else [])
    assert defects[4] <= 1e-6 and np.isfinite(second.history.column("work_total")).all()
    codes = [warning.code for warning in first.warnings]
    assert codes.count("steps.restart") == bool(changes)
    assert ("energy_balance" in first.certificate.criteria) == (not changes)


def test_a_process_does_not_go_on_from_a_static_solution(tmp_path: Path) -> None:
    folder = shared(tmp_path)
    loads = {"displacements": [{"on": "top", "value": [0.01, -0.02]}]}
    (static,) = solve_steps(slid(steps=None, loads=loads))
    save(static, folder)
    with pytest.raises(InputError, match="no checkpoint of a step"):
        list(solve_steps(slid(), restart=folder))


def test_a_step_stores_the_energy_of_the_strain_and_of_both_penalties() -> None:
    n, epsilon, limit, pressure = 10.0, 0.01, 0.02, 0.05
    found = all_of(column(penalty={"n": n, "epsilon": epsilon}, steps={"times": [1.0]}))[-1]
    stiffness = 0.7 / (1.3 * 0.4)
    beyond = (pressure - stiffness * limit) / (stiffness + 2.0 * n)
    stored = stiffness * (limit + beyond) ** 2 + 2.0 * n * beyond**2 + 0.5 * epsilon * pressure**2
    assert found.history.last("stored") == pytest.approx(stored, rel=1e-7)
