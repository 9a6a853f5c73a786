"""The output of a solve, during and after, and the public names of the package."""

from __future__ import annotations

import math
import time
from typing import Any

import pytest
from rich.console import Console
from solutions import made_up

import contact_locking
from contact_locking.command import terminal
from contact_locking.command.monitors import TerminalMonitor
from contact_locking.plain_text import per_cent
from contact_locking.results import in_words

pytestmark = pytest.mark.serial


def test_the_monitor_of_a_terminal_ends_with_a_line_per_stage_and_warns_on_standard_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with TerminalMonitor(Console(force_terminal=True, width=100)) as monitor:
        monitor.message("preparing")
        monitor.message("warning: [bold]nothing[/bold]")
        monitor.stage(1, 2, 10.0, 0.1)
        monitor.iteration(0, 1.0)
        monitor.iteration(1, 1e-3)
        monitor.friction_update(1, 0.5, None)
        monitor.counted(2, 1)
        monitor.stage(2, 2, 100.0, 0.01)
        monitor.iteration(1, 1e-9)
        monitor.counted(5, 1)
    output, errors = capsys.readouterr()
    assert errors == "warning: [bold]nothing[/bold]\n"
    assert "stage 1/2  n = 10  epsilon = 0.1  2 tangents, 1 friction update, residual" in output
    assert "stage 2/2  n = 100  epsilon = 0.01  3 tangents, residual 1.0e-09" in output


class Clock:
    """The seconds that a monitor reads."""

    now = 0.0


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(time, "perf_counter", lambda: made.now)
    return made


def test_the_log_of_a_long_stage_shows_that_the_solve_goes_on(
    capsys: pytest.CaptureFixture[str], clock: Clock
) -> None:
    with TerminalMonitor(Console(force_terminal=False, width=200)) as monitor:
        monitor.stage(1, 1, math.inf, 0.0)
        for iteration in range(4):
            monitor.iteration(iteration, 10.0**-iteration)
            for k in range(11):
                monitor.linear(k)
                clock.now += 1.0
    lines = capsys.readouterr().out.splitlines()
    # Nine lines in 44 seconds, and the one at the end of the stage.
    assert 8 <= len(lines) - 1 <= 9
    assert "stage 1/1  n = inf" in lines[5]
    assert "iteration 2, residual 1.0e-02, 28 Krylov iterations, 30 s" in lines[5]


def test_a_log_tells_no_residual_before_there_is_one(
    capsys: pytest.CaptureFixture[str], clock: Clock
) -> None:
    with TerminalMonitor(Console(force_terminal=False, width=200)) as monitor:
        for residual in (1e-3, 1e-9):
            monitor.stage(1, 1, math.inf, 0.0)
            clock.now += 10.0
            monitor.linear(1)
            monitor.iteration(1, residual)
    first, _, second, _ = capsys.readouterr().out.splitlines()
    assert first == second
    assert first.endswith("iteration 0, 1 Krylov iteration, 10 s")


def test_the_log_of_a_short_stage_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with TerminalMonitor(Console(force_terminal=False, width=200)) as monitor:
        monitor.stage(1, 1, math.inf, 0.0)
        for iteration in range(20):
            monitor.iteration(iteration, 1.0)
            monitor.linear(0)
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_an_error_leaves_no_half_finished_stage(capsys: pytest.CaptureFixture[str]) -> None:
    with (
        pytest.raises(ValueError, match="stop"),
        TerminalMonitor(Console(force_terminal=False)) as monitor,
    ):
        monitor.stage(1, 1, 10.0, 0.1)
        raise ValueError("stop")
    assert capsys.readouterr().out == ""


def test_what_a_solution_holds_can_be_imported_from_the_package() -> None:
    for name in contact_locking.__all__:
        assert getattr(contact_locking, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        contact_locking.nonsense  # noqa: B018


def summary(**changes: Any) -> dict[str, Any]:
    """The summary of a run that converged, with changes of it."""
    found: dict[str, Any] = {
        **made_up().summary,
        "cells": 1,
        "ranks": 1,
        "iterations": {"tangents": 1, "linear": 2, "friction": 0},
        "residual": 1e-9,
        "displacement_max": 0.1,
        "displacement_max_at": [1.0, 1e-20],
        "strain_norm_max": 0.02,
        "limit_used": 1.0,
        "discretisation": {"degree": 1},
        "strain_sets": [],
        "friction_force": [0.0, -0.0],
        "friction_used": 0.25,
        "contact_moment": None,
        "contacts": [{"on": ["bottom"]}],
        "reactions": {"left": [0.25, 1e-20], "right": [0.0, -0.5]},
        "contact_area": 1.0,
        "slip_area": 0.5,
        "wall_seconds": 1.0,
        "bounds": {"good": {"holds": True}, "other": {"holds": None}},
        "certificate": {
            "criteria": {
                "equilibrium": {"value": 1e-12, "limit": 1e-8, "holds": True},
                "friction_sign": {"value": 2e-9, "limit": 1e-6, "holds": True},
            },
            "constants": {"uniqueness": {"verdict": "covered by theory"}},
            "errors": {"mesh": {"relative": 0.039}, "penalty": {"relative": None}},
        },
    }
    return found | changes


def errors(**shares: float) -> dict[str, Any]:
    """A certificate with these relative errors."""
    found = {name: {"relative": share} for name, share in shares.items()}
    return summary()["certificate"] | {"errors": found}


def told(found: dict[str, Any]) -> dict[str, str]:
    return dict(in_words.rows(found))


def test_the_outcome_says_what_converged_what_is_proved_and_what_is_estimated() -> None:
    words = told(summary())
    assert words["converged"] == "yes (residual 1.0e-09)"
    assert words["iterations"] == "1 tangent, 2 linear solves, 0 friction updates"
    assert words["criteria"] == "all 2 hold; nearest to its limit: friction sign, at 0.2 % of it"
    assert words["proved"] == "1 bound of the theory, which the result keeps"
    assert words["estimated"] == "the error of the mesh is about 3.9 %"
    assert words["weakest number"] == "the error of the mesh is about 3.9 %, by an estimate"
    assert words["uniqueness"] == "proved: no other displacement solves the problem on this mesh"
    assert words["friction force"] == "(0, 0)"
    assert words["reactions"] == "(0.25, 0) on left, (0, -0.5) on right"


def test_the_outcome_names_the_criteria_and_the_bounds_that_fail() -> None:
    found = summary(bounds={"locking_work": {"holds": False}, "good": {"holds": True}})
    found["certificate"]["criteria"]["friction_sign"] |= {"value": 1e-3, "holds": False}
    assert told(found)["proved"] == "violated: locking work"
    assert told(found)["criteria"] == "1 of 2 fail: friction sign 1.0e-03, above 1e-06"


def test_a_result_with_a_large_error_is_not_plainly_converged() -> None:
    words = told(summary(certificate=errors(mesh=0.3, penalty=0.02)))
    assert words["converged"].startswith("yes, but the result is rough: the error of the mesh is")
    assert "about 30 %" in words["converged"]
    assert words["weakest number"].endswith("it takes a finer mesh, or the section adapt")
    boxes = {"degree": 1, "cells": "box"}
    words = told(summary(certificate=errors(mesh=0.3), discretisation=boxes))
    assert words["weakest number"].endswith("it takes a finer mesh")
    bounded = told(summary(certificate=errors(mesh=0.04, penalty=0.2)))
    assert "at most 20 %, by a proved bound" in bounded["converged"]
    measured = told(summary(certificate=errors(mesh=0.04, penalty=0.2, penalty_measured=0.01)))
    assert measured["converged"].startswith("yes (")
    assert "measured: the penalty changes the solution on this mesh by 1 %" in measured["estimated"]
    assert told(summary(converged=False, certificate=errors(mesh=0.3)))["converged"][:3] == "no "


def test_the_numbers_of_an_engineer_come_first_and_those_of_the_solver_last() -> None:
    words = told(summary())
    assert list(words)[:3] == ["converged", "largest displacement", "contact force"]
    assert list(words)[-3:] == ["size", "iterations", "time"]
    assert words["largest displacement"] == "0.1 at (1, 0)"
    assert words["friction used"] == "25 % of the friction bound"
    assert words["strain limit used"] == "100 % of the limit"
    assert words["locked"] == "50 % of the body is at its strain limit"


def test_what_a_body_does_not_have_takes_no_row() -> None:
    words = told(summary())
    assert "contact moment" not in words and words["slip area"] == "0.5"
    without = told(summary(friction_used=None, limit_used=None))
    gone = {"friction used", "slip area", "strain limit used", "locked"}
    assert words.keys() - without.keys() == gone
    assert not {"contact force", "contact area"} & told(summary(contacts=[])).keys()


def test_forces_that_are_rounding_beside_the_others_are_zero() -> None:
    found = summary(contact_force=[0.0, 10.0], reactions={"left": [-7e-15, 0.0]})
    assert told(found)["reactions"] == "(0, 0) on left"


def test_shares_are_written_alike_everywhere() -> None:
    shares = (0.0, 1e-6, 0.00054, 0.005, 0.198, 0.2, 1.0)
    words = ["0 %", "1e-04 %", "0.054 %", "0.5 %", "19.8 %", "20 %", "100 %"]
    assert [per_cent(share) for share in shares] == words


@pytest.mark.parametrize(
    ("variables", "warned"),
    [
        ({}, False),
        ({"SLURM_STEP_NUM_TASKS": "1"}, False),
        ({"SLURM_STEP_NUM_TASKS": "4", "SLURM_PROCID": "0"}, True),
        # The first process speaks for all.
        ({"SLURM_STEP_NUM_TASKS": "4", "SLURM_PROCID": "1"}, False),
        # srun --mpi=pmi2 says how many processes it has started, and Open MPI does not listen.
        ({"SLURM_STEP_NUM_TASKS": "4", "SLURM_PROCID": "0", "PMI_SIZE": "4"}, True),
        # A task has started one process by mpirun.
        ({"SLURM_STEP_NUM_TASKS": "4", "SLURM_PROCID": "0", "PMI_SIZE": "1"}, False),
        ({"SLURM_STEP_NUM_TASKS": "4", "OMPI_COMM_WORLD_SIZE": "1"}, False),
    ],
)
def test_processes_of_srun_that_mpi_does_not_connect_are_told_of(
    variables: dict[str, str],
    warned: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("SLURM_STEP_NUM_TASKS", "SLURM_PROCID", "PMI_SIZE", "OMPI_COMM_WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    terminal.warn_of_separate_tasks()
    assert ("srun has started 4 processes" in capsys.readouterr().err) == warned
