"""The output of a solve, during and after, and the public names of the package."""

from __future__ import annotations

from typing import Any

import pytest
from solutions import made_up

import contact_locking
from contact_locking.command.terminal import TerminalMonitor
from contact_locking.results import in_words

pytestmark = pytest.mark.serial


def test_the_monitor_of_a_terminal_ends_with_a_line_per_stage_and_warns_on_standard_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    monitor = TerminalMonitor()
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
    monitor.finish()
    output, errors = capsys.readouterr()
    assert errors == "warning: [bold]nothing[/bold]\n"
    assert "stage 1/2  n = 10  epsilon = 0.1  2 tangents, 1 friction update, residual" in output
    assert "stage 2/2  n = 100  epsilon = 0.01  3 tangents, residual 1.0e-09" in output


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
