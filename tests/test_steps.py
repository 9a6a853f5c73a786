"""Processes: steps that solve the problem at several times, with friction that remembers."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block

from contact_locking import InputError, Parameters, assemble, solve, solve_steps
from contact_locking.certificate import energy
from contact_locking.monitor import Monitor
from contact_locking.parameters import StepParameters
from contact_locking.results.history import read_history
from contact_locking.results.solution import Solution
from contact_locking.solver import SolverReport
from contact_locking.steps.increment import Increment
from contact_locking.steps.loop import Steps
from contact_locking.steps.timeline import Timeline

SHEARED = ["0.02*sin(2*pi*t)", "-0.02*min(8*t, 1)"]


def sheared(count: int = 8, to: float = 1.0, **changes: Any) -> Parameters:
    """A block that is pressed during an eighth of a cycle, and sheared to and fro all the time."""
    given: dict[str, Any] = {
        "h": 0.25,
        "loads": {"displacements": [{"on": "top", "value": SHEARED}]},
        "steps": {"to": to, "count": count},
        "material__locking_limit": 0.04,
        "penalty__n": math.inf,
    }
    return block(**(given | changes))


def all_of(parameters: Parameters) -> list[Solution]:
    solutions = list(solve_steps(parameters))
    assert all(found.converged for found in solutions), solutions[-1].summary["reason"]
    return solutions


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
        for method in ("newton", "interior_point")
    ]
    u, w = (found.displacement.x.array for found in ends)
    assert np.abs(u - w).max() <= 1e-6 * np.abs(w).max()
    slips = [found.contacts[0].slip for found in ends]
    assert np.abs(slips[0] - slips[1]).max(initial=0.0) <= 1e-7


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


def test_a_solution_of_a_step_keeps_its_displacement() -> None:
    found = all_of(sheared(3))
    displacements = [solution.displacement.x.array for solution in found]
    assert len(found) == 3
    assert all(np.abs(a - b).max() > 1e-3 for a, b in itertools.pairwise(displacements))
    assert [len(solution.history) for solution in found] == [1, 2, 3]


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
    total = row["contact_force_1_x"] + row["contact_force_2_x"]
    assert total == pytest.approx(row["contact_force_x"]) and row["contact_force_2_x"] < 0.0
    for fields in found[-1].contacts:
        assert np.all(fields.slip >= np.linalg.norm(fields.increment, axis=1))


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


class Failing:
    """Lets every solve over a longer time than ``most`` fail."""

    def __init__(self, most: float) -> None:
        self.most, self.done, self.times = most, 0.0, [0.0]

    def patch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        solve_one = Increment.solve

        def solved(increment: Increment, *given: Any) -> SolverReport:
            now = increment.problem.clock.now
            if now - self.done > self.most:
                return SolverReport(reason="too far", suggestion="be quick")
            self.done = now
            self.times.append(now)
            return solve_one(increment, *given)

        monkeypatch.setattr(Increment, "solve", solved)


@pytest.mark.parametrize("young", [1.0, 2.1e11])
def test_a_body_that_moves_without_a_touch_creates_no_energy(young: float) -> None:
    """All forces are rounding, and so is their work."""
    loads = {"displacements": [{"on": "top", "value": [0.01, "-0.03*t"]}]}
    given = block(
        h=0.5,
        loads=loads,
        contact__gap=0.04,
        material__elasticity={"young": young, "poisson": 0.3},
        penalty__n=math.inf,
        steps={"to": 1.0, "count": 3},
    )
    for found in all_of(given):
        assert found.summary["contact_force"] == [0.0, 0.0]


@pytest.mark.parametrize("on_top", ["tractions", "displacements"])
def test_what_is_zero_but_for_rounding_leaves_nothing_behind(on_top: str) -> None:
    """``sin(pi)`` is 1.2e-16: the body that was pulled along the foundation is at rest again."""
    pull = {"on": "top", "value": ["0.03*sin(pi*t)", "-0.05*sin(pi*t)"]}
    held = {"on": "left", "value": [0, 0]}
    loads: dict[str, Any] = {"tractions": [pull], "displacements": [held]}
    if on_top == "displacements":
        loads = {"displacements": [pull]}
    given = block(
        h=0.5,
        loads=loads,
        material__locking_limit=math.inf,
        penalty__n=math.inf,
        steps={"times": [0.5, 1.0]},
    )
    pulled, rests = all_of(given)
    assert np.abs(pulled.displacement.x.array).max(initial=0.0) > 0.01
    assert not rests.displacement.x.array.any()
    assert rests.summary["certificate"]["resultants"]["loads"] == [0.0, 0.0]


def test_a_step_that_does_not_converge_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    failing = Failing(0.3)
    failing.patch(monkeypatch)
    found = all_of(sheared(2))
    assert failing.times == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    halved = [text for text in found[-1].summary["warnings"] if "it is halved" in text]
    assert len(halved) == found[-1].summary["steps"]["halvings"] >= 2
    assert found[-1].summary["steps"]["solved"] == 4


def test_a_step_whose_solution_fails_a_criterion_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A state that the solver takes for a solution is not, if it is far from the last one."""
    solve_one, last = Increment.solve, [0.0]

    def wrong(increment: Increment, *given: Any) -> SolverReport:
        report, now = solve_one(increment, *given), increment.problem.clock.now
        if now - last[0] > 0.3:
            increment.problem.u.x.array[:] *= 1.001
        else:
            last[0] = now
        return report

    monkeypatch.setattr(Increment, "solve", wrong)
    found = all_of(sheared(2))
    assert [one.time for one in found] == pytest.approx([0.25, 0.5, 0.75, 1.0])
    halved = [text for text in found[-1].summary["warnings"] if "it is halved" in text]
    assert len(halved) == 2
    assert "above 1e-0" in halved[0]


def test_halving_ends_at_the_least_step(monkeypatch: pytest.MonkeyPatch) -> None:
    failing = Failing(0.01)
    failing.patch(monkeypatch)
    steps = {"to": 1.0, "count": 2, "least": 0.1}
    found = list(solve_steps(sheared(2, steps=steps, penalty__n=1e3)))
    assert len(found) == 1 and not found[0].converged
    assert found[0].summary["reason"] == "too far"
    assert found[0].summary["steps"]["halvings"] == 2


def test_a_process_goes_as_far_as_the_locking_limit_lets_it() -> None:
    # Between two clamped ends the strain is at least the relative elongation: 0.02 at t = 0.4.
    loads = {
        "displacements": [
            {"on": "left", "value": [0, None]},
            {"on": "right", "value": ["0.05*t", None]},
            {"on": ["bottom", "top"], "value": [None, 0]},
        ]
    }
    steps = {"to": 1.0, "count": 2, "least": 0.02}
    found = list(
        solve_steps(
            block(
                h=0.5,
                loads=loads,
                contact={"on": []},
                friction={},
                steps=steps,
                penalty__n=math.inf,
            )
        )
    )
    assert not found[-1].converged and found[-1].summary["reason"].startswith("infeasible")
    last = [solution.time for solution in found if solution.converged][-1]
    assert 0.4 - 0.04 <= last <= 0.4


class Told(Monitor):
    """Keeps what a solve says about its steps."""

    def __init__(self) -> None:
        self.steps: list[tuple[int, int, float, float | None]] = []

    def step(self, number: int, left: int, time: float, seconds_left: float | None) -> None:
        self.steps.append((number, left, time, seconds_left))


def test_a_monitor_hears_of_each_step_and_of_the_time_left() -> None:
    told = Told()
    list(solve_steps(sheared(3), monitor=told))
    assert [step[:2] for step in told.steps] == [(1, 3), (2, 2), (3, 1)]
    assert told.steps[0][3] is None and told.steps[2][3] is not None and told.steps[2][3] > 0.0


def test_a_script_may_change_the_problem_between_steps() -> None:
    steps = Steps(assemble(sheared(3), MPI.COMM_WORLD))
    next(steps)
    steps.problem.contacts[0].friction.share = 0.0
    second = next(steps)
    steps.close()
    assert second.converged
    # The bounds keep an inside of the cones, a share of 1e-12 of the largest.
    assert second.history.rows[-1]["dissipated"] == pytest.approx(0.0, abs=1e-12)


# The study file.


@pytest.mark.serial
def test_the_time_is_refused_without_steps() -> None:
    with pytest.raises(ValueError, match="depends on the time t, and the file has no steps"):
        block(contact__gap="0.1*t")
    loads = {"displacements": [{"on": "left", "value": ["t", 0]}]}
    with pytest.raises(ValueError, match=r"steps: \{to: 1, count: 20\}"):
        block(loads=loads)
    with pytest.raises(ValueError, match="unknown name 't'"):
        block(material__locking_limit="0.02*t", steps={"to": 1, "count": 2})


@pytest.mark.serial
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "give `to` and `count`"),
        ({"to": 1}, "give `to` and `count`"),
        ({"to": 1, "count": 2, "times": [1]}, "either `times`"),
        ({"times": []}, "one time at least"),
        ({"times": [0, 1, 1]}, "must ascend, but 1 follows 1"),
        ({"to": 1, "count": 0}, "greater than or equal to 1"),
        ({"to": -1, "count": 1}, "greater than 0"),
        ({"to": 1, "count": 1, "least": 0}, "greater than 0"),
    ],
)
def test_steps_that_make_no_sense_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        StepParameters.model_validate(given)


@pytest.mark.serial
def test_a_value_that_is_not_finite_at_some_time_is_refused_with_its_key() -> None:
    loads = {"displacements": [{"on": "top", "value": [0, "-0.01/(1 - t)"]}]}
    with pytest.raises(InputError, match="finite") as caught:
        list(solve_steps(sheared(2, loads=loads)))
    assert caught.value.key == "loads.displacements.0.value.1"


@pytest.mark.serial
def test_a_timeline_reaches_every_planned_time_whatever_fails() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        planned = [float(time) for time in np.cumsum(random.uniform(0.01, 1.0, 5))]
        timeline = Timeline(StepParameters(times=tuple(planned)))
        most, reached, tries = random.uniform(0.1, 1.0), [], 0
        while not timeline.is_over and tries < 500:
            tries += 1
            length = timeline.target - timeline.done
            if length > most * random.uniform(0.5, 1.0):
                assert timeline.fail()
                continue
            timeline.succeed()
            reached.append(timeline.done)
        assert timeline.is_over and set(planned) <= set(reached) and reached == sorted(reached)


@pytest.mark.serial
def test_a_history_is_read_as_it_was_written() -> None:
    history = all_of(sheared(2))[-1].history
    again = read_history(history.text(), "history.csv")
    assert again == history and again.columns == history.columns
    with pytest.raises(InputError, match=r"history\.csv:2"):
        read_history(history.text().replace("\n1,", "\n1,1,"), "history.csv")


@pytest.mark.parametrize("n", [1e2, 1e4])
def test_a_step_of_one_percent_of_the_load_takes_at_most_eight_tangents_on_average(
    n: float,
) -> None:
    loads = {
        "tractions": [{"on": "top", "value": ["0.03*t", "-0.05*t"]}],
        "displacements": [{"on": "left", "value": [0, 0]}],
    }
    times = [1.0, 1.01, 1.02, 1.03]
    *_, last = solve_steps(block(h=1 / 32, loads=loads, penalty__n=n, steps={"times": times}))
    assert last.converged
    assert last.history.column("tangents")[1:].mean() <= 8.0
