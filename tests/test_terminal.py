"""The output of a solve, during and after, and the public names of the package."""

from __future__ import annotations

import pytest
from rich.console import Console
from solutions import made_up

import contact_locking
from contact_locking.command.monitors import TerminalMonitor
from contact_locking.command.terminal import columns, summary_rows


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
        monitor.stage(2, 2, 100.0, 0.01)
        monitor.iteration(1, 1e-9)
    output, errors = capsys.readouterr()
    assert errors == "warning: [bold]nothing[/bold]\n"
    assert "stage 1/2  n = 10  epsilon = 0.1  1 iterations, 1 friction updates" in output
    assert "stage 2/2  n = 100  epsilon = 0.01  1 iterations, residual 1.0e-09" in output


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


def test_a_summary_table_names_a_broken_bound() -> None:
    summary = made_up().summary | {
        "cells": 1,
        "ranks": 1,
        "iterations": {"tangents": 1, "linear": 1, "friction": 1},
        "residual": 1e-9,
        "strain_norm_max": 0.02,
        "strain_norm_max_in_cells": 0.02,
        "overstrain_max": 0.0,
        "discretisation": {"degree": 1, "limit_at": "vertices"},
        "friction_force": [0.0, -0.0],
        "contact_area": 1.0,
        "slip_area": 0.5,
        "wall_seconds": 1.0,
    }
    summary["bounds"] = {"good": {"holds": True}, "bad": {"holds": False}, "other": {"holds": None}}
    summary["certificate"] = {
        "criteria": {
            "equilibrium": {"value": 1e-12, "limit": 1e-8, "holds": True},
            "friction_sign": {"value": 2e-9, "limit": 1e-6, "holds": True},
        },
        "constants": {"uniqueness": {"verdict": "not known"}},
        "errors": {"mesh": {"relative": 0.12}, "penalty": {"relative": None}},
    }
    text = columns(summary_rows(summary, 1.01, "results"))
    assert "violated: bad" in text and "= 1.01 M" in text and "(0, 0)" in text
    assert "2 hold; nearest to its limit: friction sign (2e-03 of it)" in text
    assert "mesh about 12 %" in text and "penalty at most" not in text and "not known" in text
    assert "between" not in text
    summary |= {"strain_norm_max_in_cells": 0.025, "overstrain_max": 0.25}
    text = columns(summary_rows(summary, 1.0, "results"))
    assert "1 M at the Gauss points; 0.025, 25 % beyond M, between the points" in text
    summary["certificate"]["criteria"]["friction_sign"] |= {"value": 1e-3, "holds": False}
    text = columns(summary_rows(summary, 1.01, "results"))
    assert "failed: friction_sign 1.0e-03 > 1e-06" in text
