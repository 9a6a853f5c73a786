"""Processes of tools that forces push: work, friction, and a start from a saved step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from pressed_tools import HELD, pressed, told, tool
from slow import slow

from contact_locking import InputError, Parameters, assemble, solve_steps

pytestmark = pytest.mark.serial


def cycle(**changes: Any) -> Parameters:
    """A tool that presses, is dragged by a load on the body, and lets go."""
    loads = {
        "tractions": [{"on": "right", "value": ["-0.012*t", 0.0]}],
        "displacements": HELD,
    }
    force = [0.0, "-0.03*sin(pi*t)"]
    times = {"times": [0.0, 0.25, 0.5, 0.75, 1.0]}
    given: dict[str, Any] = {"loads": loads, "steps": times, "h": 0.5}
    return pressed(tool(force), **(given | changes))


@pytest.mark.parametrize("n", [slow(1e3), math.inf])
def test_the_work_of_a_force_is_stored_or_dissipated(n: float) -> None:
    found = list(solve_steps(cycle(n=n)))
    assert all(one.converged for one in found), found[-1].summary["reason"]
    history = found[-1].history
    force, travel = history.column("tool_force"), history.column("tool_travel")
    assert force == pytest.approx(0.03 * np.sin(np.pi * history.column("t")), abs=1e-12)
    # Without a force the tool touches the body and presses with nothing.
    for one in (found[0], found[-1]):
        assert one.summary["contact_area"] == 0.0
        assert one.summary["contact_force"] == [0.0, 0.0]
    assert travel[-1] < travel[0] < travel[2]
    fields = found[-1].contacts[0]
    assert float(np.max(fields.u_normal - fields.gap, initial=-1.0)) <= 0.0
    rest = history.column("work") - np.diff(history.column("stored"), prepend=0.0)
    rest -= history.column("dissipated") + history.column("numerical")
    assert np.abs(rest).max() <= 1e-12
    assert (history.column("numerical") >= -1e-12).all()
    # Without another load the work is F dq alone.
    alone = list(solve_steps(cycle(n=n, loads={"displacements": HELD})))[-1].history
    expected = alone.column("tool_force") * np.diff(alone.column("tool_travel"), prepend=0.0)
    assert alone.column("work") == pytest.approx(expected, rel=1e-6, abs=1e-10)


def test_friction_remembers_the_slip_relative_to_the_tool() -> None:
    """A tool that moves along its own surface as well drags the body back and forth."""
    force = [0.0, -0.03]
    plane = {"point": [0.0, 1.0], "normal": [-0.4, -1.0]}
    way = {"displacements": [{"on": "bottom", "value": ["0.01*sin(2*pi*t)", 0.0]}]}
    given = pressed(
        tool(force, half_space=plane, mu=0.5), loads=way, steps={"to": 1.0, "count": 4}, h=0.5
    )
    found = list(solve_steps(given))
    assert all(one.converged for one in found), found[-1].summary["reason"]
    last = found[-1].contacts[0]
    direction = np.array([0.0, -1.0])
    travel = told(found[-1])["travel"] - told(found[-2])["travel"]
    across = direction - (last.normal @ direction)[:, None] * last.normal
    step = last.u_tangent - found[-2].contacts[0].u_tangent - travel * across
    sticks = last.state == 1
    assert found[-1].domain.comm.allreduce(int(sticks.sum())) > 0
    assert np.abs(step[sticks]).max(initial=0.0) <= 1e-9


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_a_tool_that_is_pushed_down_and_led_across_drags_the_body(n: float) -> None:
    """The plane presses with its force while its motion slides it along the body."""
    led = tool([0.0, -0.02], mu=0.3)
    led["foundation"]["motion"] = ["0.05*t", 0.0]
    given = pressed(led, n, loads={"displacements": HELD}, steps={"to": 1.0, "count": 2}, h=0.5)
    found = list(solve_steps(given))
    assert all(one.converged for one in found), found[-1].summary["reason"]
    assert found[-1].summary["contact_force"][1] == pytest.approx(-0.02, rel=1e-7)
    # In the end all of the tool slides over the body, which it drags with mu F.  Regularised
    # friction misses its bound by (delta/slip)^2/2.
    share = 1e-6 if n == math.inf else 2e-3
    assert found[-1].summary["friction_force"][0] == pytest.approx(0.3 * 0.02, rel=share)
    history = found[-1].history
    assert history.column("work").sum() > 0.3 * 0.02 * 0.02


def test_a_motion_along_the_force_is_refused() -> None:
    led = tool([0.0, -0.02])
    led["foundation"]["motion"] = [0.0, "-0.01*t"]
    with pytest.raises(InputError, match="is along foundation"):
        assemble(pressed(led, steps={"to": 1.0, "count": 2}), MPI.COMM_WORLD)
