"""V20 to V22: partial slip, the loop of cyclic slip, and a pinch that holds by friction alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import with_changes
from verification_table import Rows

from contact_locking import FrictionLaw, assemble, solve_steps
from contact_locking.arrays import FloatArray
from contact_locking.results.solution import StudySolution
from contact_locking.running.solving import SolvableStudy

pytestmark = pytest.mark.serial

YOUNG, POISSON, MU, RADIUS = 1.0, 0.45, 0.5, 2.0
#: How far the block is pressed, and moved to and fro, and the size of the elements there.
DEPTH, SHIFT, H = 0.037, 0.033, 0.0125


def on_a_cylinder(shift: str, times: list[float]) -> list[StudySolution]:
    """A block on a cylinder, pressed down until t = 1 and then moved along by ``shift``.

    The block is pressed without friction, as the theory has no traction before the shift.
    """
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [4.0, 2.0], "h": 0.4, "h_contact": H},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}, "locking_limit": math.inf},
        "loads": {"displacements": [{"on": "top", "value": [shift, f"-{DEPTH}*min(t, 1)"]}]},
        "contact": {"on": "bottom", "gap": f"(x - 2)**2/{2.0 * RADIUS}"},
        "friction": {"coefficient": MU, "smoothing": {"kernel": "none"}},
        "steps": {"times": times},
    }
    problem = assemble(with_changes(data), MPI.COMM_WORLD)
    steps = SolvableStudy(problem).solutions()
    (friction,) = (contact.friction for contact in problem.contacts)
    law, friction.law = friction.law, FrictionLaw(lambda x, s: 0.0 * s, 0.0, 0.0)
    solutions = [next(steps)]
    friction.law = law
    solutions += steps
    assert all(solution.converged for solution in solutions), solutions[-1].summary["reason"]
    return solutions


def test_v20_partial_slip_of_cattaneo_and_mindlin(found: Rows) -> None:
    """The stick zone has half-width ``c = a sqrt(1 - Q/(mu P))`` (Johnson, Contact Mechanics, 7.2).

    ``q(x) = mu p_0 (sqrt(1 - x^2/a^2) - (c/a) sqrt(1 - x^2/c^2))`` is the traction.  P, Q and the
    half-width a are those of the solution, as the block is no half-space.
    """
    solutions = on_a_cylinder(f"{SHIFT}*max(t - 1, 0)", [1.0, 1.5, 2.0])
    a = 0.5 * solutions[0].summary["contact_area"]
    for number, solution in enumerate(solutions[1:], start=1):
        force = solution.summary["contact_force"][1]
        share = abs(solution.summary["friction_force"][0]) / (MU * force)
        stick = 0.5 * (solution.summary["contact_area"] - solution.summary["slip_area"])
        c = a * math.sqrt(1.0 - share)
        points = solution.contact_points
        assert points is not None
        x = points.x[:, 0] - 2.0
        peak = MU * 2.0 * force / (math.pi * a)
        whole, inner = (np.sqrt(np.maximum(1.0 - (x / end) ** 2, 0.0)) for end in (a, c))
        exact = peak * (whole - c / a * inner)
        weights = np.gradient(x)
        error = np.abs(points.traction[:, 0]) - exact
        distance = math.sqrt(np.sum(weights * error**2) / np.sum(weights * exact**2))
        problem = f"Cattaneo-Mindlin, 2D, Q = {share:.2f} mu P"
        found.add("V20", problem, "stick half-width over a", stick / a, c / a)
        found.add("V20", problem, "traction, relative L2 error", distance, None, abs=0.1)
        assert stick == pytest.approx(c, abs=H + 0.01 * a), number
        assert 0.15 < share < 0.9


def loss(share: float) -> float:
    """The work that a cycle between ``+-Q`` loses, over ``(mu P)^2/E``; ``share`` is Q/(mu P).

    An increment of Q moves the stick zone of half-width c as a rigid punch, whose compliance in the
    plane grows like ``-B ln c`` with ``B = 2 (1 - nu^2)/(pi E)``.  The slip of the first loading is
    so ``f = (B/2) mu P phi(x)``, ``phi = (1 - x) ln(1 - x) + x``.  Unloading and reloading follow
    ``2 f(change of Q/2)`` (Masing), and the loop has the area ``2 B (mu P)^2 (x phi - 2 int phi)``.
    """
    rest = 1.0 - share
    phi = rest * math.log(rest) + share
    integral = -0.5 * rest**2 * math.log(rest) + 0.25 * (rest**2 - 1.0) + 0.5 * share**2
    return 4.0 * (1.0 - POISSON**2) / math.pi * (share * phi - 2.0 * integral)


@pytest.mark.slow
def test_v21_the_loop_of_cyclic_slip(found: Rows) -> None:
    """The second cycle repeats the first, and loses what Mindlin and Deresiewicz say."""
    # A triangular wave of period 4 that begins at t = 1 and is 1 at t = 2.
    wave = "(asin(sin(pi/2*max(t - 1, 0)))*2/pi)"
    branches = [float(time) for time in np.arange(1.0, 10.01, 0.5)]
    *_, last = on_a_cylinder(f"{SHIFT}*{wave}", branches)
    history = last.history
    time, force = history.column("t"), history.column("friction_force_x")
    spent = history.column("dissipated_total")
    ends = [int(np.flatnonzero(np.isclose(time, t))[0]) for t in (2.0, 6.0, 10.0)]
    first, second = np.diff(spent[ends])
    press = MU * history.column("contact_force_y")[ends[0]]
    share = float(abs(force[ends[0]]) / press)
    exact = loss(share) * press**2 / YOUNG
    problem = f"cyclic slip, 2D, Q = {share:.2f} mu P"
    found.add("V21", problem, "work lost in a cycle", first, exact, rel=0.1)
    found.add("V21", problem, "second cycle over first", second / first, 1.0)
    found.add("V21", problem, "force after a cycle", force[ends[1]], force[ends[0]], rel=1e-3)
    assert second == pytest.approx(first, rel=1e-2)


def creep(count: int) -> tuple[float, float]:
    """How far a pinched block sinks during ``count`` steps, and its largest displacement.

    Two walls that have moved inwards hold the block against its weight by friction alone.
    """
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [1.0, 1.0], "h": 0.25},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.03},
        "loads": {"body_force": [0.0, -0.003]},
        "contact": {"on": ["left", "right"], "gap": "-0.01*min(t, 1)"},
        "friction": {"coefficient": 0.5, "smoothing": {"kernel": "none"}},
        "steps": {"to": float(count), "count": count},
    }
    begin: FloatArray | None = None
    moved = 0.0
    for solution in solve_steps(with_changes(data)):
        assert solution.converged, solution.summary["reason"]
        u = solution.displacement.x.array
        begin = u if begin is None else begin
        moved = float(np.abs(u - begin).max())
    assert begin is not None
    return moved, float(np.abs(begin).max())


@pytest.mark.parametrize(
    "count", [10, *(pytest.param(k, marks=pytest.mark.slow) for k in (30, 1000))]
)
def test_v22_a_pinch_that_holds_does_not_creep(count: int, found: Rows) -> None:
    moved, size = creep(count)
    found.add("V22", f"pinch, {count} steps", "creep over displacement", moved / size, None)
    assert moved < 1e-6 * size
