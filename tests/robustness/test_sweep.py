"""The sweep: a sample of its problems, and its judge and reference, which know right from wrong."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from slow import slow
from sweep import judge, reference, run, unseen
from sweep.case import Case, Study, Truth, clamp, study
from sweep.discrete import Discrete, State, discretise, state_of
from sweep.families import FAMILIES, case_of
from sweep.resultants import cannot_balance
from sweep.solve import (
    BROKEN,
    INFEASIBLE,
    REFUSED,
    SOLVED,
    WRONG,
    outcome_of,
    outcome_of_case,
)
from sweep.transforms import Transform

from contact_locking.running.solving import solve_assembled
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters

pytest.importorskip("clarabel")
pytestmark = pytest.mark.serial


@pytest.mark.parametrize("family", [slow(f) if f == "grains" else f for f in FAMILIES])
def test_a_problem_of_each_family_is_right(family: str) -> None:
    outcome = outcome_of(family, 0)
    assert outcome.is_good, f"{outcome.kind}: {outcome.reason}"


@pytest.mark.parametrize("family", ["overlap", "approach_curved", "rollers", "disc", "block_3d"])
def test_an_answer_knows_neither_units_nor_position_nor_another_solver(family: str) -> None:
    """In other units, turned and mirrored, and beside Clarabel at the same friction bound."""
    outcome = outcome_of(family, 1, checks=True)
    assert outcome.kind == SOLVED, outcome.reason
    assert outcome.notes["transformed"] < 1e-14
    assert "reference" not in outcome.notes


def _seen(case: Case, **changes: Any) -> str:
    """What is missed without a word in a solution of the case whose fields are changed."""
    problem = assemble(Parameters.model_validate(case.study), MPI.COMM_SELF)
    discrete = discretise(problem.parameters, problem.domain, problem.u.function_space)
    discrete = unseen.with_band(case.truth, discrete)
    solution = solve_assembled(problem).telling(warnings=[])
    state = _with(state_of(solution, discrete), **changes)
    found = judge.violations(solution.parameters, discrete, state)
    return unseen.complaint(case.truth, discrete, state, solution, found)


def test_what_is_missed_without_a_word_is_found() -> None:
    """The solutions are right for the mesh, and the words of the program are taken away."""
    held = {"displacements": [clamp(2, "bottom")]}
    mesh = {"builder": "block", "dim": 2, "h": 0.5, "structured": True}
    tool = {"cylinder": {"centre": [0.25, 1.05], "radius": 0.1}}
    told = ("words",)
    between = Case(study(mesh, held, gap=tool, on="top"), Truth(told=told))
    assert "enters between the nodes by 1" in _seen(between)
    pull = {"displacements": [clamp(2)], "tractions": [{"on": "top", "value": [0.01, 0.0]}]}
    jump = "0.02 if x < 0.3 else 0.1"
    assert "M goes from 0.02 to 0.1" in _seen(Case(study(mesh, pull, limit=jump), Truth(told=told)))
    rough = study(mesh, pull, friction="0.5 if x < 0.3 else 0.1")
    assert "mu goes from 0.1 to 0.5" in _seen(Case(rough, Truth(told=told)))
    load = [{"on": "top", "value": [0.0, "-1 if abs(x - 0.3) < 0.1 else 0"]}]
    narrow = study(mesh, {"displacements": [clamp(2)], "tractions": load})
    assert _seen(Case(narrow, Truth(told=told, band=(0.3, 0.1, 1.0)))) == ""
    assert "narrow load is off" in _seen(Case(narrow, Truth(told=told, band=(0.35, 0.1, 1.0))))


@pytest.mark.parametrize("family", FAMILIES)
def test_the_cases_of_a_family_are_study_files_and_depend_on_their_seed_alone(family: str) -> None:
    for seed in range(5):
        case = case_of(family, seed)
        assert case == case_of(family, seed)
        assert case.study != case_of(family, seed + 100).study
        Parameters.model_validate(case.study)


@pytest.mark.parametrize(
    ("seed", "slides", "held"),
    [(10009, 3.0, 8.0), (10030, 0.9, 0.5), slow(50003, 10.0, 5.0), slow(180003, 10.0, 8.0)],
)
def test_a_process_that_friction_cannot_hold_is_refused_as_its_resultants_say(
    seed: int, slides: float, held: float
) -> None:
    """The first slides until it is pressed harder, and the second tips over in the end.

    Nothing presses the third in the end, and its support leads it off the foundation.  A tool lets
    go of the fourth, which was called balanced when it had run away with the tool.
    """
    outcome = outcome_of("process", seed)
    assert outcome.kind == REFUSED, outcome.reason
    assert cannot_balance(outcome.study, slides)
    assert not cannot_balance(outcome.study, held)


def _solved(penalty: Study) -> tuple[Parameters, Discrete, State]:
    """A block of which a part locks, sticks, slips and stands open."""
    loads = {
        "tractions": [{"on": "top", "value": [0.03, -0.05]}],
        "displacements": [clamp(2)],
    }
    mesh = {"builder": "block", "dim": 2, "h": 0.1}
    data = study(mesh, loads, limit=0.02, gap="0.001 + 0.02*(1 - x)", friction=0.3, penalty=penalty)
    problem = assemble(Parameters.model_validate(data), MPI.COMM_SELF)
    discrete = discretise(problem.parameters, problem.domain, problem.u.function_space)
    solution = solve_assembled(problem)
    assert solution.converged
    return problem.parameters, discrete, state_of(solution, discrete)


def _with(state: State, **changes: Any) -> State:
    return dataclasses.replace(state, **changes)


@pytest.mark.parametrize("penalty", [{"n": math.inf}, {"n": 1e3, "epsilon": 1e-3}])
def test_the_judge_finds_every_kind_of_mistake(penalty: Study) -> None:
    """Each changes one field by a ten-thousandth, as no solver within its tolerance may."""
    parameters, discrete, state = _solved(penalty)
    assert judge.complaint(judge.violations(parameters, discrete, state)) == ""
    share = 1.0 + 1e-4
    x = discrete.geometry.x[:, 0]
    bump = np.where(discrete.free, np.repeat(1e-4 * np.sin(5.0 * x), 2), 0.0)
    size = float(np.abs(state.u).max())
    assert discrete.contact is not None
    turned = state.traction + 1e-3 * state.bound.max() * discrete.contact.normals
    wrong = {
        "equilibrium": [
            _with(state, u=state.u + size * bump),
            _with(state, locking=share * state.locking),
            _with(state, pressure=share * state.pressure),
            _with(state, traction=share * state.traction),
        ],
        "prescribed": [_with(state, u=state.u + 1e-9 * size)],
        "pulling pressure": [_with(state, pressure=state.pressure - 1e-4 * state.pressure.max())],
        "contact law": [_with(state, pressure=state.pressure[::-1])],
        "locking law": [_with(state, locking=state.locking + np.abs(state.locking).max() * 1e-2)],
        "friction bound": [_with(state, bound=share * state.bound)],
        "traction beyond its bound": [_with(state, traction=3.0 * state.traction)],
        "friction law": [_with(state, traction=-state.traction)],
        "traction along the normal": [_with(state, traction=turned)],
    }
    if math.isinf(discrete.n):
        moved = share * np.where(discrete.free, state.u, 0.0)
        wrong["strain beyond M"] = [_with(state, u=moved)]
        wrong["penetration"] = [_with(state, u=moved)]
    for name, states in wrong.items():
        for changed in states:
            assert judge.violations(parameters, discrete, changed)[name] > 1.0, name


def test_a_wrong_claim_of_a_truth_is_found() -> None:
    """The judge compares the claims of a case: the contrary claims make the outcome wrong."""
    loads = {"displacements": [{"on": "top", "value": [0.0, -0.01]}]}
    data = study({"builder": "block", "dim": 2, "h": 0.25}, loads, friction=0.2)
    assert outcome_of_case(Case(data, Truth(touches=True)), checks=False).kind == SOLVED
    for truth in (
        Truth(touches=False),
        Truth(admissible=False),
        Truth(translation=(0.0, -0.01)),
        Truth(refused="rigid motion"),
    ):
        assert outcome_of_case(Case(data, truth), checks=False).kind == WRONG


def _stretched(limit: float, by: float) -> Study:
    """A square between rollers that is stretched along x and free to keep its height."""
    loads = {
        "displacements": [
            {"on": "left", "value": [0.0, None]},
            {"on": "right", "value": [by, None]},
            {"on": "top", "value": [None, 0.0]},
        ]
    }
    return study({"builder": "block", "dim": 2, "h": 0.25}, loads, limit=limit, gap=1.0)


@pytest.mark.parametrize("share", [0.5, 0.999, 1.001, 3.0])
def test_the_largest_factor_and_the_smallest_excess_of_a_stretched_square(share: float) -> None:
    """The least strain is uniaxial: the factor is M/delta and the excess delta/M - 1."""
    limit = 0.02
    problem = assemble(Parameters.model_validate(_stretched(limit, share * limit)), MPI.COMM_SELF)
    discrete = discretise(problem.parameters, problem.domain, problem.u.function_space)
    assert reference.largest_factor(discrete) == pytest.approx(1.0 / share, rel=1e-6)
    assert reference.smallest_excess(discrete) == pytest.approx(share - 1.0, abs=1e-6)


def test_a_true_and_a_false_verdict_of_infeasibility_are_told_apart() -> None:
    outcome = outcome_of_case(Case(_stretched(0.02, 0.021)))
    assert outcome.kind == INFEASIBLE, outcome.reason
    assert outcome.notes["excess"] == pytest.approx(0.05, abs=1e-6)
    admissible = Truth(admissible=True)
    assert outcome_of_case(Case(_stretched(0.02, 0.021), admissible)).kind == WRONG


@pytest.mark.parametrize("dim", [2, 3])
def test_a_transform_and_its_inverse_leave_a_study_as_it_was(dim: int) -> None:
    there = Transform.random(np.random.default_rng(dim), dim, homogeneous=True)
    back = Transform(
        tuple(zip(*there.rows, strict=True)),
        1.0 / there.length,
        1.0 / there.stress,
        1.0 / there.load,
    )
    np.testing.assert_allclose(back.matrix @ there.matrix, np.eye(dim))
    for family in ("anisotropic", "tilted", "overlap", "approach_curved"):
        cases = (case_of(family, seed).study for seed in range(50))
        # The axis of a cylinder is written out.
        given = next(c for c in cases if c["mesh"]["dim"] == dim and "cylinder" not in str(c))
        again = back.study(there.study(given))
        _assert_equal(Parameters.model_validate(again), Parameters.model_validate(given))


def _assert_equal(one: Parameters, other: Parameters) -> None:
    """Numbers to rounding; of expressions there is no telling."""

    def leaves(value: Any) -> list[Any]:
        if isinstance(value, dict):
            return [leaf for item in value.values() for leaf in leaves(item)]
        if isinstance(value, list | tuple):
            return [leaf for item in value for leaf in leaves(item)]
        return [value]

    pairs = zip(leaves(one.model_dump()), leaves(other.model_dump()), strict=True)
    for a, b in pairs:
        if isinstance(a, float) and isinstance(b, float) and math.isfinite(b):
            assert a == pytest.approx(b, rel=1e-12, abs=1e-12)


def test_a_worker_that_hangs_is_replaced() -> None:
    worker = run.Worker(limit=0.01)
    outcome = worker.solve(run.Task("block_2d", 0, checks=False))
    assert (outcome.kind, outcome.reason) == (BROKEN, "no answer after 0.01 s")
    assert outcome.study == case_of("block_2d", 0).study
    worker.limit = 60.0
    assert worker.solve(run.Task("zero_load", 0, checks=False)).kind != BROKEN
    worker.stop()


def test_a_refusal_counts_as_right_only_where_it_is() -> None:
    loads = {"tractions": [{"on": "top", "value": [0.0, 0.1]}]}
    data = study({"builder": "block", "dim": 2, "h": 0.5}, loads)
    assert outcome_of_case(Case(data, Truth(refused="rigid motion"))).is_good
    assert not outcome_of_case(Case(data)).is_good
