"""Forces on tools that nothing can balance are refused in words."""

from __future__ import annotations

from typing import Any

import pytest
from mpi4py import MPI
from pressed_tools import HELD, pressed, tool

from contact_locking import InputError, assemble, solve, solve_steps

pytestmark = pytest.mark.serial


@pytest.mark.parametrize(
    ("force", "why"),
    [
        ([0.0, 0.03], "does not push the foundation towards the body"),
        ([0.03, 0.0], "does not push the foundation towards the body"),
        ([0.0, "0*t"], "is zero at all times"),
        (["t", -1.0], "has another direction at t = 1"),
        ([0.0, "1.5*t - 1"], "is turned round at t = 1"),
        ([0.0, "1/(t - 0.5)"], "contact.foundation.force"),
    ],
)
def test_a_force_that_cannot_push_is_refused(force: list[Any], why: str) -> None:
    given = pressed(tool(force), steps={"to": 1.0, "count": 2})
    with pytest.raises(InputError) as raised:
        assemble(given, MPI.COMM_WORLD)
    assert why in f"{raised.value.key}: {raised.value}"


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_body_that_only_tools_hold_is_refused(mu: float) -> None:
    below = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    two = [tool([0.0, -0.03], mu=mu), tool([0.0, 0.03], "bottom", mu=mu, **below)]
    with pytest.raises(InputError, match="body and foundations can move together"):
        assemble(pressed(two, loads={}), MPI.COMM_WORLD)


def test_a_force_that_gets_too_small_to_hold_the_body_is_named() -> None:
    below = {"on": "bottom"}
    loads = {
        "tractions": [{"on": "right", "value": [0.0, 0.005]}],
        "displacements": [{"on": "left", "value": [0.0, None]}],
    }
    steps = {"times": [0.5, 1.0], "least": 0.5}
    contact = [tool([0.0, "-0.02*(1 - t)"], mu=0.0), below]
    given: dict[str, Any] = {"loads": loads, "steps": steps, "friction__coefficient": 0.0}
    found = list(solve_steps(pressed(contact, h=0.5, **given)))
    assert [one.converged for one in found] == [True, False]
    assert "translation along y" in found[-1].summary["reason"]
    assert "hold it by loads.displacements" in found[-1].summary["suggestion"]


def test_what_the_gap_and_the_tool_cannot_stop_is_still_infeasible() -> None:
    apart = [*HELD, {"on": "right", "value": ["0.1*y", None]}]
    found = solve(pressed(tool([0.0, -0.03]), loads={"displacements": apart}))
    assert not found.converged
    assert found.summary["reason"].startswith("infeasible")
