"""Branches of solutions over loads: a snap with a closed form, and an equilibrium that is lost."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from sweep.case import Study, clamp, study

import contact_locking as cl
from contact_locking import study_file
from contact_locking.mesh.domain import from_geometry
from contact_locking.process import solving
from contact_locking.results import in_words
from contact_locking.running import writing
from contact_locking.study_file.parameters import Parameters
from contact_locking.theory.equilibria.branch import Branch
from contact_locking.view import report

# Friction of the stiff block on a spring, mu = TOP - DROP s/(s + LENGTH), and what acts on it.
TOP, DROP, LENGTH = 0.3, 0.25, 0.005
STIFFNESS, PRESSURE, PULL = 0.5, 0.02, 0.005


def _on_a_spring(to: float) -> Study:
    """A stiff block that is pressed on the foundation, and pulled along it against a spring.

    R takes the mean of the pressure, which is that of the prescribed shortening.
    """
    young = 1e4
    data = study(
        {"builder": "block", "dim": 2, "h": 0.25, "structured": True},
        {
            "displacements": [{"on": "top", "value": [None, -PRESSURE / young]}],
            "springs": [{"on": "top", "stiffness": STIFFNESS, "along": [1.0, 0.0]}],
            "tractions": [{"on": "top", "value": [PULL, 0.0]}],
        },
        young=young,
        poisson=0.0,
        friction=f"{TOP} - {DROP}*s/(s + {LENGTH})",
        smoothing={"kernel": "helmholtz", "radius": 1000.0},
    )
    branches = {"over": "loads.tractions.0.value", "to": to}
    return data | {"branches": branches, "output": {"fields": False, "picture": False}}


def _pull(slip: float) -> float:
    """The share of the pull with which the block slips so far."""
    mu = TOP - DROP * slip / (slip + LENGTH)
    return (STIFFNESS * slip + mu * PRESSURE) / PULL


@pytest.mark.serial
def test_a_branch_leads_on_where_nodes_begin_to_slip() -> None:
    """``k s + mu(s) P = T`` for a stiff block: a fold where it begins to slip, and another one."""
    stiffness, pressure, pull = 0.05, 0.01, 0.0055
    data = study(
        {"builder": "block", "dim": 2, "h": 0.5, "structured": True},
        {
            "springs": [{"on": "left", "stiffness": stiffness, "along": [1.0, 0.0]}],
            "tractions": [
                {"on": "top", "value": [0.0, -pressure]},
                {"on": "right", "value": [pull, 0.0]},
            ],
        },
        young=1000.0,
        poisson=0.2,
        friction="0.2 + 0.5*exp(-s/0.01)",
        smoothing={"kernel": "none"},
    )
    data["branches"] = {"over": "loads.tractions.1.value", "to": 1.6}
    found = solving.solve(Parameters.model_validate(data), MPI.COMM_SELF).summary["branches"]
    assert found["end"] == "the last share was reached"
    # The second fold is where ``k = 50 P exp(-s/0.01)``.
    slip = 0.01 * math.log(50.0 * pressure / stiffness)
    turn = (stiffness * slip + (0.2 + stiffness / 50.0 / pressure * 0.5) * pressure) / pull
    assert found["folds"] == pytest.approx([0.7 * pressure / pull, turn], rel=2e-4)


def test_a_branch_that_stops_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Branch, "_correct", lambda *_: None)
    solution = solving.solve(Parameters.model_validate(_on_a_spring(3.0)), MPI.COMM_SELF)
    found = solution.summary["branches"]
    assert len(found["points"]["share"]) == 1 and found["end"].startswith("it stopped")


@pytest.mark.slow
@pytest.mark.serial
def test_a_block_on_a_spring_snaps_where_friction_falls_as_fast_as_the_spring(
    tmp_path: Path,
) -> None:
    """It sticks up to ``TOP p``; the branch turns again at ``k = DROP LENGTH p/(s + LENGTH)^2``."""
    solution = solving.solve(Parameters.model_validate(_on_a_spring(3.0)), MPI.COMM_SELF)
    found = solution.summary["branches"]
    turn = math.sqrt(DROP * LENGTH * PRESSURE / STIFFNESS) - LENGTH
    # Where the block begins to slip, its ends are a little ahead.
    assert found["folds"] == pytest.approx([_pull(0.0), _pull(turn)], rel=5e-4)
    assert found["leaves_at"] == found["folds"][0]
    assert found["end"] == "the last share was reached"
    points = found["points"]
    first, second = (place for place, is_fold in enumerate(points["fold"]) if is_fold)
    assert set(points["index"][:first]) == {1}
    assert set(points["index"][first + 1 : second]) == {-1}
    assert set(points["index"][second + 1 :]) == {1}
    for share, bound in zip(points["share"][second:], points["bound"][second:], strict=True):
        # The slip of a bound, and the pull that goes with it.
        part = (TOP - bound / PRESSURE) / DROP
        assert _pull(LENGTH * part / (1.0 - part)) == pytest.approx(share, rel=1e-3)
    writing.write(solution, tmp_path)
    page = report.write(tmp_path)[-1].read_text(encoding="utf-8")
    assert "over loads.tractions.0.value, from the loads of the file on" in page
    row = dict(in_words.rows(solution.summary))["branch of solutions"]
    assert row.startswith("over loads.tractions.0.value: ")


@pytest.mark.slow
@pytest.mark.serial
def test_a_block_wedges_where_the_branch_over_its_displacement_turns() -> None:
    """Below the fold the problem has the solution of the branch, and beyond none is found."""
    path = Path(__file__).parents[2] / "demos" / "studies" / "lost_equilibrium.yml"
    key = "loads.displacements.1.value.1"

    def solved(share: float, **branches: Any) -> Any:
        changes = ["friction.coefficient=0.28", "study=null", f"{key}={-0.0111 * share}"]
        data = study_file.load(path, changes).parameters
        if branches:
            changes.append(f"branches={{over: {branches['over']}, to: {branches['to']}}}")
            data = study_file.load(path, changes).parameters
        return solving.solve(data, MPI.COMM_SELF)

    found = solved(1.0, over=key, to=1.2).summary["branches"]
    assert max(found["points"]["share"]) == pytest.approx(found["folds"][0], rel=1e-6)
    assert found["folds"][0] == pytest.approx(1.001185, abs=2e-6)
    place = int(np.argmin(np.abs(np.array(found["points"]["share"]) - 1.0008)))
    below = solved(found["points"]["share"][place])
    assert below.converged
    pressure = found["points"]["pressure"][place]
    assert below.summary["contact_force"][1] == pytest.approx(pressure, rel=1e-3)
    assert not solved(1.005).converged


def _clamped(**sections: Any) -> Study:
    data = study(
        {"builder": "block", "dim": 2, "h": 0.5, "structured": True},
        {"displacements": [clamp(2)], "tractions": [{"on": "top", "value": [0.004, -0.02]}]},
        friction=0.3,
        smoothing={"kernel": "convolution", "radius": 0.3},
    )
    return data | sections


@pytest.mark.parametrize("to", [1.5, 0.5])
def test_without_a_gap_the_solution_is_proportional_to_the_loads(to: float) -> None:
    data = _clamped(branches={"over": "loads", "to": to})
    found = solving.solve(Parameters.model_validate(data)).summary["branches"]
    points = found["points"]
    assert found["end"] == "the last share was reached"
    assert found["folds"] == []
    assert points["share"][0] == 1.0
    assert (points["share"][-1] - to) * (to - 1.0) >= 0.0
    for name in ("pressure", "bound"):
        slopes = np.array(points[name]) / np.array(points["share"])
        assert slopes == pytest.approx(slopes[0] * np.ones(len(slopes)), rel=1e-3)


def test_a_branch_over_a_constant_of_a_script_is_that_of_the_study() -> None:
    study_solution = solving.solve(
        Parameters.model_validate(_clamped(branches={"over": "loads.tractions", "to": 1.3}))
    )
    domain = from_geometry(study_solution.parameters.mesh.geometry, MPI.COMM_WORLD, ("bottom",))
    space = fem.functionspace(domain.mesh, ("Lagrange", 1, (2,)))
    pull = fem.Constant(domain.mesh, (0.004, -0.02))
    v = ufl.TestFunction(space)
    held = fem.locate_dofs_geometrical(space, lambda x: np.isclose(x[0], 0.0))
    problem = cl.ContactProblem(
        cl.Elasticity(young=1.0, poisson=0.3),
        ufl.inner(pull, v) * domain.ds(("top",), "top"),
        [fem.dirichletbc(np.zeros(2), held, space)],
        contacts=[
            cl.Contact(
                domain.facets(("bottom",), "on"),
                cl.HalfSpace((0.0, 0.0), (0.0, 1.0)),
                cl.Coulomb(0.3, cl.Convolution(0.3)),
            )
        ],
        n=math.inf,
    )
    found = cl.branch(problem, to=1.3, over=pull)
    problem.close()
    assert tuple(pull.value) == (0.004, -0.02)
    points = study_solution.summary["branches"]["points"]
    assert [point.share for point in found.points] == pytest.approx(points["share"], rel=1e-6)
    assert [point.pressure for point in found.points] == pytest.approx(points["pressure"], rel=1e-4)


def test_a_key_that_is_no_load_is_refused() -> None:
    for key in ("loads.springs", "friction.smoothing.radius", "loads.tractions.1"):
        with pytest.raises(ValueError, match="names no load"):
            Parameters.model_validate(_clamped(branches={"over": key}))


def test_a_branch_over_loads_begins_at_a_solution() -> None:
    data = _clamped(branches={"over": "loads"}, solver={"max_iterations": 1})
    solution = solving.solve(Parameters.model_validate(data))
    assert not solution.converged
    assert "not found" in solution.summary["branches"]["end"]
    assert solution.summary["branches"]["leaves_at"] is None
