"""The sweep: a sample of its problems and its design; its judge knows right from wrong."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from slow import slow
from sweep import run, unseen
from sweep.case import Case, Study, Truth, clamp, study
from sweep.comparisons import against_transformed
from sweep.covering import pairs_in, pairs_of
from sweep.elements import Mesh
from sweep.families import FAMILIES, PAIRS, case_of
from sweep.judge import Judge, complaint
from sweep.observed import Moment, Touch, mesh_of, moment_of
from sweep.pair_features import FEATURES, agree, rows
from sweep.reference import Programme
from sweep.resultants import cannot_balance
from sweep.solve import (
    BROKEN,
    INFEASIBLE,
    NOT_SOLVED,
    REFUSED,
    SOLVED,
    WRONG,
    judge_of,
    outcome_of,
    outcome_of_case,
)
from sweep.transforms import Transform

from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve_assembled, solve_steps
from contact_locking.study_file.dump import plain
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

pytest.importorskip("clarabel")

Judged = tuple[Study, Mesh, tuple[Moment, ...]]
Change = Callable[[Moment], Moment]


@cache
def _solved(n: float, element: str, gap: float = 1e-3) -> Judged:
    """A block in two steps, of which a part locks, sticks, slips and stands open."""
    data: Study = {
        "mesh": {"builder": "block", "h": 0.15, "cells": "box" if element == "Q1" else "simplex"},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
        "loads": {
            "tractions": [{"on": "top", "value": ["0.04*t", "-0.05*t"]}],
            "displacements": [clamp(2)],
        },
        "contact": [{"on": "bottom", "gap": f"{gap} + 0.02*(1 - x)"}],
        "friction": {
            "coefficient": "0.1/(1 + 100*s)",
            "smoothing": {"kernel": "convolution", "radius": 0.4},
            "regularisation": 0.0 if math.isinf(n) else 1e-6,
        },
        "discretisation": {"degree": int(element[1])},
        "penalty": {"n": n} | ({} if math.isinf(n) else {"epsilon": 1e-2}),
        "steps": {"to": 1.0, "count": 2},
    }
    moments = []
    for solution in solve_steps(Parameters.model_validate(data), MPI.COMM_SELF):
        assert solution.converged
        mesh = mesh_of(solution.domain, solution.displacement.function_space, data)
        moments.append(moment_of(solution, mesh))
    return data, mesh, tuple(moments)


_KINDS = [(n, element) for n in (math.inf, 1e3) for element in ("P1", "P2", "Q1")]


@pytest.mark.parametrize(("n", "element"), _KINDS)
def test_the_judge_finds_no_fault_with_a_solution(n: float, element: str) -> None:
    data, mesh, moments = _solved(n, element)
    assert complaint(Judge(data, mesh).violations(moments)) == ""
    states = moments[-1].contacts[0]
    slides = np.linalg.norm(states.traction, axis=1) > 0.98 * states.bound
    assert (states.pressure > 0.0).any() and slides[states.pressure > 0.0].any()
    assert np.abs(moments[-1].locking).max() > 0.0


def _touch(change: Callable[[Touch], dict[str, Any]]) -> Change:
    def changed(m: Moment) -> Moment:
        touches = (dataclasses.replace(touch, **change(touch)) for touch in m.contacts)
        return dataclasses.replace(m, contacts=tuple(touches))

    return changed


def _bumped(m: Moment) -> Moment:
    """A wave, zero where the body is held, of a ten-thousandth of the displacement."""
    wave = 1e-4 * np.abs(m.u).max() * np.sin(5.0 * m.u / np.abs(m.u).max())
    return dataclasses.replace(m, u=m.u + wave)


def _lying(m: Moment) -> Moment:
    """About the force of the foundation."""
    (entry,) = copy.deepcopy(m.summary["contacts"])
    entry["contact_force"] = [2.0 * part for part in entry["contact_force"]]
    return dataclasses.replace(m, summary=m.summary | {"contacts": [entry]})


# A ten-thousandth of a field, as no solver within its tolerance may err.
_SHARE = 1.0 + 1e-4
_MISTAKES: list[tuple[Change, str]] = [
    (lambda m: dataclasses.replace(m, u=_SHARE * m.u), "equilibrium"),
    (_bumped, "equilibrium"),
    (lambda m: dataclasses.replace(m, locking=_SHARE * m.locking), "equilibrium"),
    (_touch(lambda t: {"pressure": _SHARE * t.pressure}), "equilibrium"),
    (_touch(lambda t: {"traction": _SHARE * t.traction}), "equilibrium"),
    (lambda m: dataclasses.replace(m, u=m.u + 1e-9 * np.abs(m.u).max()), "prescribed"),
    (_touch(lambda t: {"pressure": t.pressure - 1e-4 * t.pressure.max()}), "pulling pressure"),
    (_touch(lambda t: {"pressure": t.pressure[::-1]}), "contact law"),
    (_touch(lambda t: {"traction": 3.0 * t.traction}), "friction above its bound"),
    (_touch(lambda t: {"traction": -t.traction}), "friction law"),
    (
        _touch(lambda t: {"traction": t.traction + 1e-3 * t.bound.max() * t.normal}),
        "friction along the normal",
    ),
    (_touch(lambda t: {"bound": _SHARE * t.bound}), "reported bound"),
    (_touch(lambda t: {"gap": t.gap + 1e-4}), "reported gap"),
    (lambda m: dataclasses.replace(m, elastic=_SHARE * m.elastic), "reported stress"),
    (_lying, "balance of forces"),
]


@pytest.mark.parametrize(("n", "element"), _KINDS)
@pytest.mark.parametrize(("change", "law"), _MISTAKES)
def test_the_judge_finds_a_mistake(n: float, element: str, change: Change, law: str) -> None:
    data, mesh, moments = _solved(n, element)
    found = Judge(data, mesh).violations([*moments[:-1], change(moments[-1])])
    assert found[law] > 1.0, found


@pytest.mark.parametrize(("n", "element"), _KINDS)
def test_the_judge_finds_a_solution_that_misses_the_foundation(n: float, element: str) -> None:
    """The solution for a foundation that is farther away is none for a near one."""
    data, mesh, moments = _solved(n, element, gap=4e-3)
    near = copy.deepcopy(data) | {"contact": _solved(n, element)[0]["contact"]}
    found = Judge(near, mesh).violations(moments)
    assert found["penetration" if math.isinf(n) else "contact law"] > 1.0
    assert found["reported gap"] > 1.0


def test_an_answer_that_depends_on_units_is_found() -> None:
    """In energies to 1e-5 of the largest."""
    data, mesh, moments = _solved(math.inf, "P1")
    same, judge = Transform(((1.0, 0.0), (0.0, 1.0))), Judge(data, mesh)
    for share, is_same in ((1.0, True), (_SHARE, False)):
        energy = share * moments[0].summary["elastic_energy"]
        told = moments[0].summary | {"elastic_energy": energy}
        others = [dataclasses.replace(moments[0], summary=told), *moments[1:]]
        assert (against_transformed(same, judge, moments, others)[0] == "") == is_same


def test_the_judge_knows_what_friction_remembers() -> None:
    """Without the first step the second has another slip, and another coefficient."""
    data, mesh, moments = _solved(math.inf, "P1")
    found = Judge(data, mesh).violations(moments[1:])
    assert found["friction law"] > 1.0 or found["reported bound"] > 1.0


def test_the_judge_knows_the_strain_beyond_its_limit_and_the_penalty() -> None:
    data, mesh, moments = _solved(math.inf, "P1")
    tight = copy.deepcopy(data)
    tight["material"]["locking_limit"] = 0.0199
    assert Judge(tight, mesh).violations(moments)["strain beyond its limit"] > 1.0
    data, mesh, moments = _solved(1e3, "P1")
    stiff = copy.deepcopy(data)
    stiff["penalty"]["n"] = 1.1e3
    assert Judge(stiff, mesh).violations(moments)["locking penalty"] > 1.0


def _moved(key: str) -> Change:
    """What the summary says of the foundation, made one per cent larger."""

    def change(m: Moment) -> Moment:
        (entry,) = copy.deepcopy(m.summary["contacts"])
        entry["tool"][key] = (1.01 * np.array(entry["tool"][key])).tolist()
        return dataclasses.replace(m, summary=m.summary | {"contacts": [entry]})

    return change


@pytest.mark.parametrize("dim", [2, 3])
def test_the_judge_knows_the_forces_of_free_foundations(dim: int) -> None:
    down = [*[0.0] * (dim - 1), -1.0]
    foundation: Study = {
        "half_space": {"point": [0.5] * (dim - 1) + [1.0], "normal": down},
        "force": [0.01 * part for part in down],
        "spring": {"stiffness": 0.5},
    }
    mesh = {"builder": "block", "dim": dim, "h": {2: 0.25, 3: 0.5}[dim]}
    none = {"kernel": "none"}
    held = {"displacements": [clamp(dim, "bottom")]}
    data = study(mesh, held, gap=foundation, on="top", friction=0.3, smoothing=none)
    problem = assemble(Parameters.model_validate(data), MPI.COMM_SELF)
    judge = judge_of(problem, data)
    moment = moment_of(solve_assembled(problem), judge.mesh)
    assert complaint(judge.violations([moment])) == ""
    for key, law in (("travel", "force of a tool"), ("direction", "direction of a tool")):
        assert judge.violations([_moved(key)(moment)])[law] > 1.0, law


def _unsaid(case: Case) -> str:
    """What is missed without a word in a solution of the case."""
    problem = assemble(Parameters.model_validate(case.study), MPI.COMM_SELF)
    judge = judge_of(problem, case.study)
    judge.given_load = unseen.load_of_band(case.truth, judge.body)
    moment = moment_of(solve_assembled(problem), judge.mesh)
    return unseen.complaint(case.truth, judge, moment, [], judge.violations([moment]))


def test_what_is_missed_without_a_word_is_found() -> None:
    """The solutions are right for the mesh, and the words of the program are taken away."""
    held = {"displacements": [clamp(2, "bottom")]}
    mesh = {"builder": "block", "dim": 2, "h": 0.5, "structured": True}
    tool = {"cylinder": {"centre": [0.25, 1.05], "radius": 0.1}}
    told = ("words",)
    between = Case(study(mesh, held, gap=tool, on="top"), Truth(told=told))
    assert "enters between the nodes by 1" in _unsaid(between)
    pull = {"displacements": [clamp(2)], "tractions": [{"on": "top", "value": [0.01, 0.0]}]}
    jump = study(mesh, pull, limit="0.02 if x < 0.3 else 0.1")
    assert "M goes from 0.02 to 0.1" in _unsaid(Case(jump, Truth(told=told)))
    rough = study(mesh, pull, friction="0.5 if x < 0.3 else 0.1")
    assert "mu goes from 0.1 to 0.5" in _unsaid(Case(rough, Truth(told=told)))
    load = [{"on": "top", "value": [0.0, "-1 if abs(x - 0.3) < 0.1 else 0"]}]
    narrow = study(mesh, {"displacements": [clamp(2)], "tractions": load})
    assert _unsaid(Case(narrow, Truth(told=told, band=(0.3, 0.1, 1.0)))) == ""
    assert "narrow load is off" in _unsaid(Case(narrow, Truth(told=told, band=(0.35, 0.1, 1.0))))


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


def test_a_refusal_counts_as_right_only_where_it_is() -> None:
    loads = {"tractions": [{"on": "top", "value": [0.0, 0.1]}]}
    data = study({"builder": "block", "dim": 2, "h": 0.5}, loads)
    assert outcome_of_case(Case(data, Truth(refused="rigid motion"))).is_good
    assert not outcome_of_case(Case(data)).is_good


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
    data = _stretched(0.02, share * 0.02)
    problem = assemble(Parameters.model_validate(data), MPI.COMM_SELF)
    programme = Programme(judge_of(problem, data))
    assert programme.largest_factor() == pytest.approx(1.0 / share, rel=1e-6)
    assert programme.smallest_excess() == pytest.approx(share - 1.0, abs=1e-6)


def test_a_true_and_a_false_verdict_of_infeasibility_are_told_apart() -> None:
    outcome = outcome_of_case(Case(_stretched(0.02, 0.021)))
    assert outcome.kind == INFEASIBLE, outcome.reason
    assert outcome.notes["excess"] == pytest.approx(0.05, abs=1e-6)
    admissible = Truth(admissible=True)
    assert outcome_of_case(Case(_stretched(0.02, 0.021), admissible)).kind == WRONG


@pytest.mark.parametrize("dim", [2, 3])
def test_a_transform_and_its_inverse_leave_a_study_as_it_was(dim: int) -> None:
    random, mesh = np.random.default_rng(dim), {"builder": "block", "dim": dim}
    there = Transform.random(random, {"mesh": mesh}, homogeneous=True)
    rows = tuple(zip(*there.rows, strict=True))
    back = Transform(rows, 1.0 / there.length, 1.0 / there.stress, 1.0 / there.load)
    np.testing.assert_allclose(back.matrix @ there.matrix, np.eye(dim))
    for family in ("anisotropic", "tilted", "overlap", "approach_curved", "sprung", "heated"):
        cases = (case_of(family, seed).study for seed in range(50))
        # The axis of a cylinder is written out.
        given = next(c for c in cases if c["mesh"]["dim"] == dim and "cylinder" not in str(c))
        again = back.study(there.study(given))
        # Numbers to rounding; of expressions there is no telling.
        found, wanted = (_numbers(plain(Parameters.model_validate(s))) for s in (again, given))
        assert found == pytest.approx(wanted, rel=1e-12, abs=1e-12)


def _numbers(data: Any) -> list[float]:
    if isinstance(data, dict | list | tuple):
        inner = data.values() if isinstance(data, dict) else data
        return [number for item in inner for number in _numbers(item)]
    return [data] if isinstance(data, float) and math.isfinite(data) else []


pytest.importorskip("clarabel")


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


@pytest.mark.parametrize("family", FAMILIES)
def test_the_cases_of_a_family_are_study_files_and_depend_on_their_seed_alone(family: str) -> None:
    for seed in range(5):
        case = case_of(family, seed)
        assert case == case_of(family, seed)
        assert case.study != case_of(family, seed + 100).study
        Parameters.model_validate(case.study)


@pytest.mark.parametrize(
    ("family", "seed", "kind"),
    [
        # A facet of the other body is seen from its side.
        ("grains", 2021, SOLVED),
        # Bodies in another frame than that of the data have nothing admissible.
        ("grains", 2004, NOT_SOLVED),
        # Corners of a facet lie on one side, though their normals turn much.
        ("curved_3d", 2006, SOLVED),
        # R of a quadratic trace is negative where p >= 0, which derivatives have to know.
        ("sprung", 7019, SOLVED),
        # Iterates are 1e6 times the solution, whose prescribed values they must not round.
        ("pairs", 5347, SOLVED),
    ],
)
def test_a_problem_that_was_wrong_is_judged_right(family: str, seed: int, kind: str) -> None:
    outcome = outcome_of(family, seed)
    assert outcome.kind == kind, outcome.reason


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
    problem = assemble(Parameters.model_validate(outcome.study), MPI.COMM_SELF)
    judge = judge_of(problem, outcome.study)
    assert cannot_balance(judge, slides)
    assert not cannot_balance(judge, held)


def test_a_problem_without_an_end_is_broken_and_the_next_one_is_solved() -> None:
    outcome = run.solved(run.Task("block_2d", 0, checks=False), limit=0.01)
    assert outcome.kind == BROKEN and "TimeoutError: no answer after 0.01 s" in outcome.reason
    assert outcome.study == case_of("block_2d", 0).study
    (outcome,) = run.sweep([run.Task("zero_load", 0, checks=False)], jobs=1, limit=60.0)
    assert outcome.kind == SOLVED


def test_every_compatible_pair_of_values_occurs_and_no_other() -> None:
    found = set().union(*(pairs_in(row) for row in rows()))
    assert found == pairs_of(FEATURES, agree)
    assert 80 <= len(rows()) <= 200


def test_the_problems_of_pairs_are_study_files_and_depend_on_their_seed_alone() -> None:
    count = len(rows())
    for seed in range(count):
        case = case_of(PAIRS, seed)
        assert case.row.split() == list(rows()[seed].values())
        Parameters.model_validate(case.study)
        other = case_of(PAIRS, seed + count)
        assert other.row == case.row
        assert other.study != case.study
    assert case_of(PAIRS, 5) == case_of(PAIRS, 5)


@pytest.mark.parametrize("seed", [4, 5, 11])
def test_a_problem_of_pairs_is_right(seed: int) -> None:
    outcome = outcome_of(PAIRS, seed)
    assert outcome.kind == SOLVED, outcome.reason
