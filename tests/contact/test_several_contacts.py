"""A body with several contacts, each with its own foundation and friction."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block, solved
from slow import slow

from contact_locking import StudySolution, save, solve
from contact_locking.errors import InputError
from contact_locking.study_file.parameters import Parameters

NONE = {"kernel": "none"}


def between(dim: int, contact: Any, **changes: Any) -> Parameters:
    """A block that is sheared between its bottom and its top, which touch different foundations."""
    push = [{"on": "right", "value": [-0.01, *[0.0] * (dim - 2), 0.004]}]
    held = [{"on": "left", "value": [0.004, *[None] * (dim - 1)]}]
    given: dict[str, Any] = {
        "contact": contact,
        "loads": {"tractions": push, "displacements": held},
        "friction": {"coefficient": 0.2, "smoothing": NONE},
        "penalty__n": math.inf,
    }
    return block(dim, 0.125 if dim == 2 else 0.34, **(given | changes))


def same(one: StudySolution, other: StudySolution, share: float = 1e-7) -> None:
    """The displacements agree, relative to their size; collective."""
    a, b = one.displacement.x.array, other.displacement.x.array
    comm = one.domain.comm
    size, difference = (comm.allreduce(np.abs(x).max(), op=MPI.MAX) for x in (a, a - b))
    assert size > 0.0 and difference <= share * size


@pytest.mark.parametrize(("dim", "n"), [(2, 1e3), slow(2, math.inf), slow(3, 1e3), (3, math.inf)])
def test_two_parts_without_a_common_node_are_one_contact_or_two(dim: int, n: float) -> None:
    overlap = {"gap": -0.003}
    one = solved(between(dim, {"on": ["bottom", "top"], **overlap}, penalty__n=n))
    entries = [{"on": name, **overlap} for name in ("bottom", "top")]
    two = solved(between(dim, entries, penalty__n=n))
    same(one, two)
    totals = ("contact_force", "friction_force", "contact_area", "slip_area", "penetration_max")
    for key in (*totals, "friction_used"):
        assert two.summary[key] == pytest.approx(one.summary[key], rel=1e-5, abs=1e-9)
    parts = two.summary["contacts"]
    assert np.sum([part["contact_force"] for part in parts], axis=0) == pytest.approx(
        two.summary["contact_force"], abs=1e-15
    )
    # Both foundations press.
    assert [np.sign(part["contact_force"][-1]) for part in parts] == [1.0, -1.0]


def test_loads_that_press_the_body_onto_neither_foundation_are_refused() -> None:
    loads = {"tractions": [{"on": "right", "value": [0.01, 0.0]}]}
    contact = [{"on": "bottom"}, {"on": "left", "friction": {"coefficient": 0.0}}]
    with pytest.raises(InputError, match="do not press the body onto the foundation"):
        solve(between(2, contact, loads=loads))


@pytest.mark.parametrize("tampered", [0, 1])
def test_the_certificate_judges_each_contact(
    tampered: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    from contact_locking.certificate.verdict import certify
    from contact_locking.process import problem_solver

    def tamper(state: Any, *more: Any) -> Any:
        fields = state.contacts[tampered]
        fields.pressure = 1.1 * fields.pressure
        return certify(state, *more)

    monkeypatch.setattr(problem_solver, "certify", tamper)
    entries = [{"on": "bottom"}, {"on": "top", "gap": -0.003}]
    summary = solve(between(2, entries)).summary
    criteria = summary["certificate"]["criteria"]
    assert not summary["converged"] and not criteria["equilibrium"]["holds"]
    assert not criteria["friction_bound"]["holds"]


def test_a_state_of_two_contacts_is_saved_and_solves_the_same_problem_at_once(
    tmp_path: Path,
) -> None:
    directory = Path(MPI.COMM_WORLD.bcast(str(tmp_path)))
    entries = [{"on": "bottom"}, {"on": "top", "gap": -0.003, "friction": {"coefficient": 0.5}}]
    parameters = between(2, entries)
    first = solved(parameters)
    save(first, directory)
    again = solve(parameters, restart=directory)
    assert again.converged and again.summary["iterations"]["tangents"] == 0
    same(first, again, 1e-12)
