"""The output of a solve, during and after, and the public names of the package."""

from __future__ import annotations

import pytest

import contact_locking
from contact_locking.command.terminal import TerminalMonitor

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
    monitor.stage(1, 1, 1000.0, 0.0)  # another solve
    monitor.counted(1, 0)
    monitor.finish()
    output, errors = capsys.readouterr()
    assert errors == "warning: [bold]nothing[/bold]\n"
    assert "stage 1/2  n = 10  epsilon = 0.1  2 tangents, 1 friction update, residual" in output
    assert "stage 2/2  n = 100  epsilon = 0.01  3 tangents, residual 1.0e-09" in output
    assert "stage 1/1  n = 1e+03  epsilon = 0  1 tangent, 0." in output


def test_what_a_solution_holds_can_be_imported_from_the_package() -> None:
    for name in contact_locking.__all__:
        assert getattr(contact_locking, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        contact_locking.nonsense  # noqa: B018
