"""Bodies that contact or friction alone holds: solved, refused, or told why nothing holds them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import solved
from sweep.case import Study

from contact_locking.contact.coulomb import FrictionBound
from contact_locking.errors import InputError
from contact_locking.results import in_words
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve, solve_assembled
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

_LOCAL = {"kernel": "none"}
_WIDE = {"kernel": "convolution", "radius": 1.0}


def pushed(
    dim: int, along: float, mu: float | str = 0.2, smoothing: Study = _LOCAL, **more: Any
) -> Parameters:
    """A flat block that a traction presses onto a plane, and pushes along it."""
    size = [4.0, 2.0, 1.0] if dim == 3 else [4.0, 1.0]
    data = {
        "mesh": {"builder": "block", "dim": dim, "size": size, "h": 1.0 if dim == 3 else 0.3},
        "material": {"elasticity": {"young": 1000.0, "poisson": 0.3}},
        "loads": {"tractions": [{"on": "top", "value": [along, *[0.0] * (dim - 2), -10.0]}]},
        "contact": {"on": "bottom"},
        "friction": {"coefficient": mu, "smoothing": smoothing},
    }
    return Parameters.model_validate(data | more)


def failure(parameters: Parameters) -> tuple[str, str]:
    """What is said of a solve that fails, and the advice."""
    found = solve(parameters)
    assert not found.converged
    return found.summary["reason"], found.summary["suggestion"]


@pytest.mark.parametrize("dim", [2, 3])
def test_a_push_above_mu_times_the_force_is_told_with_its_motion(dim: int) -> None:
    why, advice = failure(pushed(dim, 2.1))
    assert "translation along x" in why
    assert "whatever the pressure (proved on this mesh)" in why
    assert "raise friction.coefficient" in advice and "lower friction" not in advice


def test_where_r_moves_the_bound_it_is_that_which_the_solver_reached() -> None:
    """``int R p`` exceeds ``int p`` where the pressure gathers at the ends of Gamma_C."""
    why, advice = failure(pushed(2, 2.1, smoothing=_WIDE))
    assert "with the friction bound that the solver reached: it slides" in why
    assert "which needs 8.4, and friction holds" in why and "lower friction" not in advice
    far, _ = failure(pushed(2, 3.0, smoothing=_WIDE))
    assert "whatever the pressure (proved on this mesh)" in far


def test_all_of_the_friction_is_used_at_the_limit() -> None:
    found = solved(pushed(2, 2.0))
    assert found.summary["friction_used"] == pytest.approx(1.0, abs=1e-6)
    assert found.summary["contacts"][0]["friction_used"] == found.summary["friction_used"]
    rows = dict(in_words.rows({**found.summary, "wall_seconds": 0.0, "ranks": 1}))
    assert rows["friction used"] == "100 % of the friction bound"


@pytest.mark.parametrize("mu", [0.2, 5.0])
@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_a_body_that_tips_is_told_about_which_edge(mu: float, unit: float) -> None:
    loads = {"tractions": [{"on": "top", "value": [20.0, -5.0]}]}
    mesh = {"builder": "block", "size": [unit, 3.0 * unit], "h": 0.5 * unit}
    with pytest.raises(InputError) as caught:
        assemble(pushed(2, 0.0, mu=mu, mesh=mesh, loads=loads), MPI.COMM_WORLD)
    assert f"(rotation about ({unit:g}, 0)): the loads do not press" in str(caught.value)


@pytest.mark.parametrize("value", [[0.0, 1.0], [0.0, 0.0], [3.0, 1.0]])
def test_a_body_that_nothing_presses_is_told_so(value: list[float]) -> None:
    loads = {"tractions": [{"on": "top", "value": value}]}
    with pytest.raises(InputError, match="the loads do not press"):
        assemble(pushed(2, 0.0, loads=loads), MPI.COMM_WORLD)


def test_friction_may_hold_a_body_between_walls_that_open() -> None:
    """The body leaves both walls if it moves up, and slides along them: friction resists."""
    walls = [
        {"on": "left", "foundation": {"half_space": {"point": [0.001, 0], "normal": [1, 0.05]}}},
        {"on": "right", "foundation": {"half_space": {"point": [0.999, 0], "normal": [-1, 0.05]}}},
    ]
    given = pushed(
        2,
        0.0,
        mu=0.5,
        mesh={"builder": "block", "h": 0.25},
        contact=walls,
        loads={"body_force": [0.0, 0.01]},
    )
    found = solved(given)
    forces = np.add(found.summary["contact_force"], found.summary["friction_force"])
    assert forces == pytest.approx([0.0, -0.01], abs=1e-8)


def hardening(law: str) -> StudySolution:
    """A pressure of 0.02 and a shear of 0.006 that ask for mu = 0.3."""
    loads = {
        "tractions": [{"on": "top", "value": [0, -0.02]}, {"on": "bottom", "value": [0.006, 0]}]
    }
    data = {
        "mesh": {"builder": "block", "h": 0.25},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.0}},
        "loads": loads,
        "contact": {"on": "bottom"},
        "friction": {"coefficient": law, "smoothing": {"radius": 0.6}},
    }
    return solved(Parameters.model_validate(data))


@pytest.mark.parametrize(
    "law", ["0.1 + 0.4*min(s/0.02, 1)", "0.1 + 0.4*min(s/0.02, 1) if s < 0.5 else 0.1"]
)
def test_friction_that_grows_with_the_slip_holds_a_body_after_a_slip_of_0_01(law: str) -> None:
    found = hardening(law)
    assert found.contacts[0].slip == pytest.approx(0.01, rel=1e-7)
    assert found.contacts[0].bound == pytest.approx(0.006, rel=1e-7)
    assert found.summary["iterations"]["tangents"] <= 12
    # It slips everywhere, and holds more if it slips on.
    assert found.summary["friction_used"] == pytest.approx(1.0) and not found.summary["warnings"]


def _block(loads: dict[str, Any], gap: float = 0.0, friction: float = 0.5, **mesh: Any) -> Any:
    return {
        "mesh": {"builder": "block", "dim": 2, "h": 0.2} | mesh,
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": loads,
        "contact": {"on": "bottom", "gap": gap},
        "friction": {"coefficient": friction, "smoothing": {"kernel": "none"}},
    }


def _pulled(pull: float, pressure: float, unit: float) -> dict[str, Any]:
    """A traction along the foundation, its moment balanced by those of the sides."""
    values = {"top": [pull, -pressure], "right": [0.0, pull], "left": [0.0, -pull]}
    return {
        "tractions": [
            {"on": on, "value": [unit * component for component in value]}
            for on, value in values.items()
        ]
    }


def _solution(data: dict[str, Any]) -> StudySolution:
    return solving.solve(Parameters.model_validate(data))


@pytest.mark.parametrize("unit", [1e-20, 1.0, 1e9])
def test_a_pull_that_exceeds_the_friction_is_refused_in_any_unit(unit: float) -> None:
    """Far away from the foundation rounding in u exceeds the loads, which still do not balance."""
    data = _block(_pulled(0.0131985, 0.0091526, unit))
    if unit > 1.0:
        data["material"]["elasticity"]["young"] = unit
    found = _solution(data)
    assert not found.converged
    assert found.failure == "solver.unheld"


# It takes minutes on two ranks.
@pytest.mark.parametrize(
    ("friction", "what"),
    [pytest.param(0.5, "friction", marks=pytest.mark.serial), (0.0, "contact")],
)
def test_a_body_that_its_support_leads_off_the_foundation_is_refused(
    friction: float, what: str
) -> None:
    """At t = 1 nothing presses any more, and the pull leads along the rollers and up."""
    loads = {
        "tractions": [{"on": "top", "value": [0.002, "-(0.02*sin(pi*t))"]}],
        "supports": [{"on": "left", "along": [1.0, -0.3]}],
    }
    data = _block(loads, friction=friction) | {"steps": {"times": [0.5, 1.0]}}
    *_, before, last = solving.solve_steps(Parameters.model_validate(data))
    assert before.converged
    assert not last.converged
    assert last.failure == "solver.unheld"
    assert "translation along x and y" in last.summary["reason"]


def test_a_bound_of_the_users_own_holds_no_more_than_the_solver_reached() -> None:
    class Own(FrictionBound):
        def evaluate(self, pressure: Any, slip: Any) -> Any:
            return super().evaluate(pressure, slip)

    problem = assemble(pushed(2, 3.0), MPI.COMM_WORLD)
    (contact,) = problem.contacts
    contact.friction = Own(contact.surface, contact.friction.smoothing, contact.friction.law)
    found = solve_assembled(problem)
    assert not found.converged and "needs 12" in found.summary["reason"]
