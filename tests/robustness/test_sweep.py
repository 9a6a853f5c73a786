"""The sweep: a sample of its problems, and the design of the family of pairs."""

from __future__ import annotations

import pytest
from mpi4py import MPI
from slow import slow
from sweep import run
from sweep.covering import pairs_in, pairs_of
from sweep.families import FAMILIES, PAIRS, case_of
from sweep.pair_features import FEATURES, agree, rows
from sweep.resultants import cannot_balance
from sweep.solve import BROKEN, REFUSED, SOLVED, judge_of, outcome_of

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
    problem = assemble(Parameters.model_validate(outcome.study), MPI.COMM_SELF)
    judge = judge_of(problem, outcome.study)
    assert cannot_balance(judge, slides)
    assert not cannot_balance(judge, held)


def test_a_worker_that_hangs_is_replaced() -> None:
    worker = run.Worker(limit=0.01)
    outcome = worker.solve(run.Task("block_2d", 0, checks=False))
    assert (outcome.kind, outcome.reason) == (BROKEN, "no answer after 0.01 s")
    assert outcome.study == case_of("block_2d", 0).study
    worker.limit = 60.0
    assert worker.solve(run.Task("zero_load", 0, checks=False)).kind != BROKEN
    worker.stop()


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
