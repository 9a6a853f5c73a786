"""The family of pairs: its design has every pair, and its judge knows right from wrong."""

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
from sweep import pair_judge, run
from sweep.covering import design, pairs_in, pairs_of
from sweep.families import PAIRS, case_of
from sweep.observed import Moment, Touch, mesh_of, moment_of
from sweep.own_body import Mesh, simplex_rule, value
from sweep.pair_features import FEATURES, agree, rows
from sweep.pair_judge import Judge, complaint
from sweep.solve import CLAIM, NOT_SOLVED, SOLVED, WRONG, Outcome, outcome_of, outcome_of_case

from contact_locking.process.solving import solve_assembled, solve_steps
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

Study = dict[str, Any]
Judged = tuple[Study, Mesh, tuple[Moment, ...]]


def test_every_compatible_pair_of_values_occurs_and_no_other() -> None:
    found = set().union(*(pairs_in(row) for row in rows()))
    assert found == pairs_of(FEATURES, agree)
    assert 80 <= len(rows()) <= 200


def test_a_design_tells_the_pairs_that_no_row_can_have() -> None:
    """Where a is 1, c can be neither with b = 1; the pair of a and b is of no row."""
    features = {name: ("0", "1") for name in "abc"}
    excluded = [{("a", "1"), ("c", "0")}, {("b", "1"), ("c", "1")}]
    found, out_of_reach = design(features, lambda one, other: {one, other} not in excluded)
    assert out_of_reach == {frozenset({("a", "1"), ("b", "1")})}
    assert all(not (row["a"] == "1" and row["c"] == "0") for row in found)


def test_the_problems_are_study_files_and_depend_on_their_seed_alone() -> None:
    count = len(rows())
    for seed in range(count):
        case = case_of(PAIRS, seed)
        assert case.row.split() == list(rows()[seed].values())
        Parameters.model_validate(case.study)
        other = case_of(PAIRS, seed + count)
        assert other.row == case.row
        assert other.study != case.study
    assert case_of(PAIRS, 5) == case_of(PAIRS, 5)


@pytest.mark.parametrize("seed", [4, 5, 6, 11, slow(70), slow(82)])
def test_a_problem_of_pairs_is_right(seed: int) -> None:
    outcome = outcome_of(PAIRS, seed)
    assert outcome.kind == SOLVED, outcome.reason


@pytest.mark.parametrize("seed", [14, 69])
def test_each_locking_stress_of_an_iterative_solver_keeps_its_penalty_law(seed: int) -> None:
    """Where the duality gap alone ended the iteration, single ones were off by up to 1e-4."""
    case = case_of(PAIRS, seed)
    assert case.study["solver"]["linear"] == "iterative"
    case.study["solver"]["method"] = "interior_point"
    outcome = outcome_of_case(case, checks=False)
    assert outcome.kind == SOLVED, outcome.reason


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_the_rule_of_the_judge_integrates_polynomials(dim: int) -> None:
    """The mean of prod x_i^a_i over a simplex is d! prod a_i!/(d + sum a_i)!."""
    points, weights = simplex_rule(dim)
    for powers in np.ndindex(*[4] * (dim + 1)):
        if sum(powers) > 4:
            continue
        mean = float(weights @ np.prod(points ** np.array(powers), axis=1))
        factors = math.prod(math.factorial(power) for power in powers)
        exact = math.factorial(dim) * factors / math.factorial(dim + sum(powers))
        assert mean == pytest.approx(exact, rel=1e-13)


def test_the_judge_reads_expressions() -> None:
    x = np.array([[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_allclose(value("2*x + min(y, 3)*t", x, t=0.5), [3.0, 7.5])


@cache
def _solved(n: float, degree: int, gap: float = 1e-3) -> Judged:
    """A block in two steps, of which a part locks, sticks, slips and stands open."""
    study: Study = {
        "mesh": {"builder": "block", "dim": 2, "h": 0.15},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
        "loads": {
            "tractions": [{"on": "top", "value": ["0.04*t", "-0.05*t"]}],
            "displacements": [{"on": "left", "value": [0.0, 0.0]}],
        },
        "contact": [{"on": "bottom", "gap": f"{gap} + 0.02*(1 - x)"}],
        "friction": {
            "coefficient": "0.1/(1 + 100*s)",
            "smoothing": {"kernel": "convolution", "radius": 0.4},
            "regularisation": 0.0 if math.isinf(n) else 1e-6,
        },
        "discretisation": {"degree": degree},
        "penalty": {"n": n} | ({} if math.isinf(n) else {"epsilon": 1e-2}),
        "steps": {"to": 1.0, "count": 2},
    }
    moments = []
    for solution in solve_steps(Parameters.model_validate(study), MPI.COMM_SELF):
        assert solution.converged
        mesh = mesh_of(solution, {"top", "left", "bottom"}, set())
        moments.append(moment_of(solution, mesh))
    return study, mesh, tuple(moments)


_KINDS = [(math.inf, 1), (math.inf, 2), (1e3, 1), (1e3, 2)]


@pytest.mark.parametrize(("n", "degree"), _KINDS)
def test_the_judge_finds_no_fault_with_a_solution(n: float, degree: int) -> None:
    study, mesh, moments = _solved(n, degree)
    assert complaint(Judge(study, mesh).violations(moments)) == ""
    states = moments[-1].contacts[0]
    slides = np.linalg.norm(states.traction, axis=1) > 0.98 * states.bound
    assert (states.pressure > 0.0).any() and slides[states.pressure > 0.0].any()
    assert np.abs(moments[-1].locking).max() > 0.0


Change = Callable[[Moment], Moment]


def _touch(change: Callable[[Touch], Touch]) -> Change:
    return lambda m: dataclasses.replace(m, contacts=tuple(map(change, m.contacts)))


def _shifted(m: Moment) -> Moment:
    """The displacement larger by one per cent."""
    return dataclasses.replace(m, u=1.01 * m.u)


def _bumped(m: Moment) -> Moment:
    """One node off by one per cent of the displacement."""
    u = m.u.copy()
    u[len(u) // 2] += 0.01 * np.abs(u).max()
    return dataclasses.replace(m, u=u)


_pulling = _touch(lambda t: dataclasses.replace(t, pressure=-t.pressure))
_rubbing = _touch(lambda t: dataclasses.replace(t, traction=1.1 * t.traction))
_pushing = _touch(lambda t: dataclasses.replace(t, traction=-t.traction))
_boasting = _touch(lambda t: dataclasses.replace(t, bound=1.01 * t.bound))
_shallow = _touch(lambda t: dataclasses.replace(t, gap=t.gap + 1e-4))


def _soft(m: Moment) -> Moment:
    return dataclasses.replace(m, locking=0.99 * m.locking)


def _unaware(m: Moment) -> Moment:
    return dataclasses.replace(m, elastic=0.99 * m.elastic)


def _lying(m: Moment) -> Moment:
    force = [2.0 * part for part in m.summary["contact_force"]]
    return dataclasses.replace(m, summary=m.summary | {"contact_force": force})


_MISTAKES: list[tuple[Change, str]] = [
    (_shifted, "equilibrium"),
    (_bumped, "equilibrium"),
    (_pulling, "pulling pressure"),
    (_rubbing, "friction above its bound"),
    (_pushing, "friction law"),
    (_boasting, "reported bound"),
    (_shallow, "reported gap"),
    (_soft, "equilibrium"),
    (_unaware, "reported stress"),
    (_lying, "balance of forces"),
]


@pytest.mark.parametrize(("n", "degree"), _KINDS)
@pytest.mark.parametrize(("change", "law"), _MISTAKES, ids=[c.__name__ for c, _ in _MISTAKES])
def test_the_judge_finds_a_mistake(n: float, degree: int, change: Change, law: str) -> None:
    study, mesh, moments = _solved(n, degree)
    found = Judge(study, mesh).violations([*moments[:-1], change(moments[-1])])
    assert found[law] > 1.0, found


@pytest.mark.parametrize(("n", "degree"), _KINDS)
def test_the_judge_finds_a_solution_that_misses_the_foundation(n: float, degree: int) -> None:
    """The solution for a foundation that is farther away is none for a near one."""
    study, mesh, moments = _solved(n, degree, gap=4e-3)
    near = copy.deepcopy(study) | {"contact": _solved(n, degree)[0]["contact"]}
    found = Judge(near, mesh).violations(moments)
    assert found["penetration" if math.isinf(n) else "contact law"] > 1.0
    assert found["reported gap"] > 1.0


def test_the_judge_knows_what_friction_remembers() -> None:
    """Without the first step the second has another slip, and another coefficient."""
    study, mesh, moments = _solved(math.inf, 1)
    found = Judge(study, mesh).violations(moments[1:])
    assert found["friction law"] > 1.0 or found["reported bound"] > 1.0


def test_the_judge_knows_the_strain_beyond_its_limit_and_the_penalty() -> None:
    study, mesh, moments = _solved(math.inf, 1)
    tight = copy.deepcopy(study)
    tight["material"]["locking_limit"] = 0.0199
    assert Judge(tight, mesh).violations(moments)["strain beyond its limit"] > 1.0
    study, mesh, moments = _solved(1e3, 1)
    stiff = copy.deepcopy(study)
    stiff["penalty"]["n"] = 1.01e3
    assert Judge(stiff, mesh).violations(moments)["locking penalty"] > 1.0


def _moved(**told: Any) -> Change:
    """What the summary says of the foundation, made one per cent larger."""

    def change(m: Moment) -> Moment:
        (entry,) = copy.deepcopy(m.summary["contacts"])
        for part, key in told.items():
            entry[part][key] = (1.01 * np.array(entry[part][key])).tolist()
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
    study: Study = {
        "mesh": {"builder": "block", "dim": dim, "h": {2: 0.25, 3: 0.5}[dim]},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": {"displacements": [{"on": "bottom", "value": [0.0] * dim}]},
        "contact": [{"on": "top", "foundation": foundation}],
        "friction": {"coefficient": 0.3, "smoothing": {"kernel": "none"}},
        "discretisation": {"degree": 1},
        "penalty": {"n": math.inf},
    }
    solution = solve_assembled(assemble(Parameters.model_validate(study), MPI.COMM_SELF))
    mesh = mesh_of(solution, {"top", "bottom"}, set())
    moment, judge = moment_of(solution, mesh), Judge(study, mesh)
    assert complaint(judge.violations([moment])) == ""
    mistakes = [
        (_moved(tool="travel"), "force of a tool"),
        (_moved(tool="direction"), "direction of a tool"),
    ]
    for change, law in mistakes:
        assert judge.violations([change(moment)])[law] > 1.0, law


@pytest.mark.parametrize("norm", ["strain", "deviator", "volume", "direction", "weighted"])
def test_the_sets_of_the_judge_have_maps_of_norm_one(norm: str) -> None:
    study, mesh, _ = _solved(math.inf, 1)
    entry: Study = {"norm": norm, "at_most": 0.01}
    more: dict[str, Study] = {
        "direction": {"along": [2.0, 1.0]},
        "weighted": {"matrix": np.eye(3) * 5.0},
    }
    entry |= more.get(norm, {})
    judge = Judge(study | {"material": study["material"] | {"locking": [entry]}}, mesh)
    ((maps, limit),) = pair_judge.strain_sets(judge.body)
    assert np.linalg.svd(maps, compute_uv=False)[0] == pytest.approx(1.0)
    share = {"volume": math.sqrt(0.5), "weighted": 0.2}.get(norm, 1.0)
    np.testing.assert_allclose(limit, 0.01 * share)


@pytest.mark.parametrize("kernel", ["convolution", "helmholtz"])
@pytest.mark.parametrize("degree", [1, 2])
def test_the_smoothing_of_the_judge_keeps_constants(kernel: str, degree: int) -> None:
    study, mesh, moments = _solved(math.inf, degree)
    smoothing = {"kernel": kernel, "radius": 0.4}
    judge = Judge(study | {"friction": study["friction"] | {"smoothing": smoothing}}, mesh)
    contact = judge.contacts[0]
    R = contact.smoothing(moments[0].contacts[0].normal, np.ones(len(contact.nodes), dtype=bool))
    np.testing.assert_allclose(R.sum(axis=1), 1.0, rtol=1e-12)
    assert np.ptp(R @ contact.x[:, 0]) < 0.99 * np.ptp(contact.x[:, 0])


def test_a_body_that_may_rest_is_known() -> None:
    study, mesh, _ = _solved(math.inf, 1)
    assert Judge(study, mesh).rest_is_admissible([0.5, 1.0])
    deep = copy.deepcopy(study)
    deep["contact"][0]["gap"] = "0.01 - 0.02*t"
    assert Judge(deep, mesh).rest_is_admissible([0.5])
    assert not Judge(deep, mesh).rest_is_admissible([0.5, 1.0])


def test_the_summary_has_the_shares() -> None:
    kinds = [SOLVED, SOLVED, CLAIM, NOT_SOLVED, WRONG]
    outcomes = [Outcome(PAIRS, i, kind, tangents=30 * i, row="x") for i, kind in enumerate(kinds)]
    told = run.of_pairs(outcomes)
    for part in ("right 40.0 % (2)", "unsolved 20.0 % (1)", "above 50 tangents 60.0 % (3)"):
        assert part in told
    assert run.of_pairs([Outcome("block_2d", 0, SOLVED)]) == ""
