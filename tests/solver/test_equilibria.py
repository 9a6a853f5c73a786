"""The map of friction bounds, its branch past folds, and several solutions of one problem."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from sweep.case import Study, clamp, study

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.solution import Solution
from contact_locking.running import run as writing
from contact_locking.running import solving
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import SolvableStudy
from contact_locking.solver.task import Task
from contact_locking.study_file.parameters import Parameters
from contact_locking.theory import words
from contact_locking.theory.bound_map import BoundMap, Branch, OverShare
from contact_locking.theory.constants import BY_KAPPA
from contact_locking.theory.search import Equilibria, equilibria, has_map


def _weakening(n: float = math.inf, length: float = 1e-4, **sections: Any) -> Study:
    """A clamped block whose friction falls steeply with the slip."""
    found = study(
        {"builder": "block", "dim": 2, "h": 0.125, "structured": True},
        {
            "displacements": [clamp(2)],
            "tractions": [{"on": "top", "value": [0.004, -0.02]}],
        },
        friction=f"0.3 - 0.25*s/(s + {length})",
        smoothing={"kernel": "convolution", "radius": 0.3},
    )
    return found | {"penalty": {"n": n}} | sections


def _solutions(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> list[Solution]:
    found = solving.solve(parameters, comm)
    return [found, *found.others]


def _solver(data: Study) -> ProblemSolver:
    problem = assemble(Parameters.model_validate(data), MPI.COMM_WORLD)
    solver = SolvableStudy(problem).solver
    solver.begin()
    return solver


@pytest.fixture
def task() -> Iterator[Task]:
    solver = _solver(_weakening())
    yield Task(solver.system, solver.target, solver.settings)
    solver.close()
    solver.problem.close()


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_the_derivative_of_the_map_is_that_of_its_values(n: float) -> None:
    solver = _solver(_weakening(n, length=1e-2))
    problem = BoundMap(Task(solver.system, solver.target, solver.settings))
    vectors = problem.vectors
    bounds = problem(problem(np.zeros(vectors.size)))
    problem(bounds)
    derivative = problem.derivative()
    step = bounds * np.linspace(0.2, 1.0, vectors.size)
    width = 1e-3
    sides = [problem(bounds + sign * width * step) for sign in (1.0, -1.0)]
    difference = np.asarray((sides[0] - sides[1]) / (2.0 * width), dtype=float)
    wrong: FloatArray = difference - derivative @ step
    error = vectors.norm(wrong)
    # Iterates end on the central path, whose laws are smooth where those of the problem are not.
    assert error <= 1e-3 * vectors.norm(difference)
    problem.destroy()


@pytest.mark.serial
def test_the_branch_turns_and_keeps_its_equation(task: Task) -> None:
    """With 70 % of the coefficient there are three solutions on the branch, one of another sign."""
    problem = BoundMap(task)
    points = []
    for point in Branch(OverShare(problem)).points():
        points.append(point)
        if point.share > 0.9:
            break
    problem.destroy()
    shares = [point.share for point in points]
    assert shares[0] == 0.0
    assert shares[-1] > 0.9
    assert min(np.diff(shares)) < 0.0
    assert {point.sign for point in points} == {1.0, -1.0}


@pytest.mark.serial
def test_friction_that_alone_holds_a_body_has_no_map() -> None:
    data = study(
        {"builder": "block", "dim": 2, "h": 0.5, "structured": True},
        {"tractions": [{"on": "top", "value": [0.001, -0.02]}]},
        friction=0.3,
        smoothing={"kernel": "convolution", "radius": 0.6},
    )
    solver = _solver(data)
    assert not has_map(Task(solver.system, solver.target, solver.settings))
    with pytest.raises(InputError, match="friction alone"):
        next(equilibria(solver.task, solver.solve(), 2))
    solver.close()


@pytest.mark.serial
def test_branches_need_friction_and_one_problem() -> None:
    data = _weakening(branches={"to": 0.1})
    with pytest.raises(InputError, match="needs friction"):
        solving.solve(Parameters.model_validate(data | {"friction": {"coefficient": 0.0}}))
    with pytest.raises(ValueError, match="does not go with steps"):
        Parameters.model_validate(data | {"steps": {"times": [1.0]}})
    with pytest.raises(ValueError, match="to"):
        Parameters.model_validate(data | {"branches": {"to": 0.0}})


@pytest.mark.serial
def test_a_body_that_nothing_presses_has_one_solution_and_no_branch() -> None:
    parameters = Parameters.model_validate(
        {
            "mesh": {"builder": "block", "h": 0.5},
            "loads": {"displacements": [{"on": "left", "value": [0, 0]}]},
            "contact": {"on": "bottom", "gap": 0},
            "friction": {"coefficient": 0.3},
            "equilibria": {"find": 3},
            "branches": {"to": 1.2},
        }
    )
    (found,) = _solutions(parameters, MPI.COMM_SELF)
    assert found.converged
    assert "add up to 1, and so do" in found.summary["equilibria"]["missing"]
    assert found.summary["branches"]["points"]["share"] == []


def test_a_study_finds_several_certified_solutions(tmp_path: Path) -> None:
    parameters = Parameters.model_validate(
        _weakening(equilibria={"find": 2}, output={"fields": False, "picture": False})
    )
    found = _solutions(parameters)
    assert len(found) == 2
    assert all(solution.converged for solution in found)
    forces = [solution.summary["friction_force"][0] for solution in found]
    assert abs(forces[1] - forces[0]) > 0.5 * abs(forces[0])
    entry = found[0].summary["equilibria"]
    assert [row["folder"] for row in entry["solutions"]] == [".", "equilibrium_2"]
    assert [row["index"] for row in entry["solutions"]] == [1, 1]
    assert "there are 1 others at least" in entry["missing"]
    folder = MPI.COMM_WORLD.bcast(tmp_path)
    writing.write(found[0], folder)
    table = words.equilibria(found[0].summary)
    assert [row[0] for row in table] == ["equilibria", ".", "equilibrium_2"]
    assert (folder / "equilibrium_2" / "contact.csv").exists()


def _third_block(size: float, young: dict[str, float], mu: float, loads: dict[str, Any]) -> Study:
    """A block of thirds on local friction, of which at most ten solutions are searched."""
    mesh = {"builder": "block", "size": [1.0, size], "h": 1.0 / 3.0, "structured": True}
    found = study(mesh, loads, friction=mu, smoothing={"kernel": "none"})
    material = {"elasticity": {"young": 1.0, **young}, "locking_limit": math.inf}
    return found | {"material": material, "penalty": {"n": math.inf}, "equilibria": {"find": 10}}


def _pulled_third_block() -> Study:
    """It touches nothing without friction."""
    loads = {
        "displacements": [clamp(2)],
        "tractions": [{"on": "right", "value": [0.029443538154816293, 0.0003890180454922069]}],
    }
    return _third_block(1.0, {"poisson": 0.03303525011198971}, 6.7037315589007385, loads)


@pytest.mark.serial
def test_a_block_that_touches_nothing_has_two_further_solutions() -> None:
    """All combinations of open, sticking and sliding nodes leave three: one node sticks or slides.

    Its pressure is 0.01983 or 0.001514, and it has half of a third of the boundary.
    """
    found = _solutions(Parameters.model_validate(_pulled_third_block()))
    forces = sorted(solution.summary["contact_force"][1] for solution in found)
    np.testing.assert_allclose(forces, [0.0, 0.001514 / 6.0, 0.01983 / 6.0], rtol=1e-3, atol=1e-12)
    assert sorted(solution.summary["index"] for solution in found) == [-1, 1, 1]


@pytest.mark.serial
def test_nothing_is_searched_beside_a_solution_that_is_proved_to_be_unique(
    monkeypatch: Any,
) -> None:
    loads = {
        "displacements": [clamp(2)],
        "tractions": [{"on": "right", "value": [0.009532586164096106, -0.04512764329765403]}],
    }
    data = _third_block(2.0 / 3.0, {"poisson": 0.3847669482775273}, 0.1256769803726298, loads)
    parameters = Parameters.model_validate(data | {"certificate": {"constants": True}})

    def search(*_: Any) -> Iterator[FloatArray]:
        yield pytest.fail("a search beside a solution that is unique")

    monkeypatch.setattr(Equilibria, "others", search)
    (found,) = _solutions(parameters)
    verdict = found.summary["certificate"]["constants"]["uniqueness"]
    assert verdict["verdict"] == BY_KAPPA and found.summary["index"] == 1
    assert "kappa is below 1" in found.summary["equilibria"]["missing"]


@pytest.mark.serial
def test_a_solution_that_is_the_only_one_is_not_found_again() -> None:
    top = {"on": "top", "value": [0.005766154728078064, -0.0035503511531850725]}
    right = {"on": "right", "value": [0.019467886730568002, -0.03410015127565173]}
    loads = {"displacements": [top], "tractions": [right]}
    data = _third_block(2.0 / 3.0, {"poisson": 0.11307192278048947}, 10.858313132829654, loads)
    data["contact"] = {"on": "bottom", "gap": -0.004294269749203719}
    assert len(_solutions(Parameters.model_validate(data))) == 1
