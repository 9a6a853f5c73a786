"""Problems that a first solver got wrong: each is solved, and rightly, or rightly has no solution.

What is told of a solution is judged by the sweep's own sums, and by the conic solver.
"""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import solved
from sweep.case import Case, Study, clamp, study
from sweep.solve import SOLVED, WEDGED, outcome_of_case

from contact_locking import study_file
from contact_locking.findings import Finding
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.study_file.dump import plain
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial


def solution_of(data: Study) -> StudySolution:
    solution = solved(Parameters.model_validate(data), MPI.COMM_SELF)
    return solution


@pytest.mark.slow
@pytest.mark.parametrize("file", sorted(Path(__file__).with_name("unsolved").rglob("*.yml")))
def test_an_unsolved_problem_ends_with_a_step_that_says_so_and_claims_no_more(file: Path) -> None:
    """A later planned time may be impossible; of the step that was tried nothing is proved."""
    *before, last = solving.solve_steps(study_file.load(file).parameters, MPI.COMM_SELF)
    assert bool(before) == (file.parent.name == "processes")
    assert all(found.converged for found in before)
    assert not last.converged
    of_the_step = last.summary["reason"].rpartition("did not converge: ")[-1]
    assert not of_the_step.startswith("infeasible")
    assert "grow with the penalty" not in of_the_step


@pytest.mark.slow
@pytest.mark.parametrize("file", sorted(Path(__file__).with_name("pairwise").glob("*.yml")))
def test_a_hard_pair_of_features_is_solved_or_told_to_be_wedged(file: Path) -> None:
    *before, last = solving.solve_steps(study_file.load(file).parameters, MPI.COMM_SELF)
    assert all(found.converged for found in before)
    is_wedged = "There is no equilibrium" in file.read_text(encoding="utf-8")
    assert last.converged != is_wedged, last.summary["reason"]
    assert (last.failure == "solver.forces_grow") == is_wedged


@pytest.mark.slow
@pytest.mark.parametrize("file", sorted(Path(__file__).with_name("wedged").glob("*.yml")))
def test_forces_that_grow_are_seen_with_penalties_that_are_soft_enough(file: Path) -> None:
    """With stiffer penalties these problems are not solved."""
    case = Case(plain(study_file.load(file).parameters))
    outcome = outcome_of_case(case, checks=False)
    assert outcome.kind == WEDGED, outcome.reason


def test_a_finite_penalty_has_a_solution_where_friction_wedges_a_body_in() -> None:
    path = Path(__file__).parent / "wedged" / "curved_overlap.yml"
    case = Case(plain(study_file.load(path, ["penalty.n=1e4"]).parameters))
    outcome = outcome_of_case(case, checks=False)
    assert outcome.kind == SOLVED, outcome.reason


def _pressed(young: float, stress: float, **more: Any) -> Study:
    loads = {
        "tractions": [{"on": "top", "value": [0.0, -stress]}],
        "displacements": [clamp(2)],
    }
    mesh = {"builder": "block", "dim": 2, "h": 0.2}
    return study(mesh, loads, young=young, friction=0.4, **more)


@pytest.mark.parametrize("young", [2.1e11, 2e6])
def test_who_says_nothing_of_penalties_gets_the_inequality_in_any_unit(young: float) -> None:
    """With n = 1e4 Pa the foundation was as good as absent: a contact force of 6.5 for 6.2e7."""
    silent = solution_of(_pressed(young, 5e-4 * young, penalty={}))
    exact = solution_of(_pressed(young, 5e-4 * young, penalty={"n": math.inf}))
    force, wanted = (s.summary["contact_force"] for s in (silent, exact))
    np.testing.assert_allclose(force, wanted, rtol=1e-6, atol=1e-6 * abs(wanted[1]))
    assert wanted[1] == pytest.approx(0.62 * 5e-4 * young, rel=0.2)


@pytest.mark.parametrize("kernel", ["convolution", "none"])
def test_the_displacement_scales_with_a_tiny_load(kernel: str) -> None:
    """Friction was 2 to 9 % off where its bound was below 1e-14 of the stiffness."""
    share = 1e-30
    loads = {
        "tractions": [{"on": "top", "value": [0.9, -0.6]}],
        "displacements": [clamp(2)],
    }
    mesh = {"builder": "block", "dim": 2, "h": 0.2}
    data = study(mesh, loads, friction=0.5, smoothing={"kernel": kernel, "radius": 0.25})
    tiny = copy.deepcopy(data)
    tiny["loads"]["tractions"][0]["value"] = [0.9 * share, -0.6 * share]
    u, v = (solution_of(d).displacement.x.array for d in (data, tiny))
    assert np.abs(v / share - u).max() <= 1e-7 * np.abs(u).max()


def _lifted_sheet(height: float, **more: Any) -> Study:
    """A sheet of steel of 300 to 1 on a floor, lifted at one end; N, mm, per mm of width."""
    loads = {
        "body_force": [0.0, -7.7e-5],
        "displacements": [{"on": "right", "value": [None, height]}],
    }
    mesh = {"builder": "block", "dim": 2, "size": [300.0, 1.0], "h": 1.0, "structured": True}
    data = study(mesh, loads, young=2e5, **more)
    data["material"]["plane"] = "stress"
    data["discretisation"] = {"degree": 2}
    return data


@pytest.mark.parametrize(("height", "close"), [(1.0, 1e-4), (1e-7, 1e-2)])
def test_a_sheet_that_is_lifted_needs_the_same_force_held_by_friction_and_by_a_roller(
    height: float, close: float
) -> None:
    """A beam that is lifted over the length L by h: ``h = w L^4/(24 E I)``, and the force w L/2.

    The lower height lifts a part that is hardly longer than thick, where friction acts a little.
    """
    rubbing = _lifted_sheet(height, friction=0.2, smoothing={"kernel": "none"})
    rolling = _lifted_sheet(height)
    rolling["loads"]["displacements"].append({"on": "left", "value": [0.0, None]})
    forces = [solution_of(data).summary["reactions"]["right"][1] for data in (rubbing, rolling)]
    assert forces[0] == pytest.approx(forces[1], rel=close)
    if height == 1.0:
        stiffness, weight = 2e5 / 12.0, 7.7e-5
        lifted = (24.0 * stiffness * height / weight) ** 0.25
        assert forces[0] == pytest.approx(0.5 * weight * lifted, rel=0.03)


def test_a_penalty_that_is_soft_for_the_material_is_warned_of_with_one_that_does() -> None:
    """Steel in pascals on a foundation of 1/epsilon = n = 1e4 Pa/m, which it hardly feels."""
    soft = solution_of(_pressed(2e11, 1e8, penalty={"n": 1e4}))
    (finding,) = [text for text in soft.warnings if isinstance(text, Finding)]
    assert finding.code == "contact.penetration" and finding.numbers["parameter"] == "penalty.n"
    assert f"penalty.n: {finding.numbers['value']:.1e} " in finding
    stiff = solution_of(_pressed(2e11, 1e8, penalty={"n": finding.numbers["value"]}))
    assert not stiff.warnings
    # Ranks send each other what they find.
    sent = pickle.loads(pickle.dumps(finding))
    assert sent == finding and (sent.code, sent.numbers) == (finding.code, finding.numbers)
    largest = abs(stiff.displacement.x.array).max()
    assert stiff.summary["penetration_max"] <= 0.02 * largest
