"""Nodes that Gamma_C shares with the part of the boundary that is held: no contact acts there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block, solved

from contact_locking import StudySolution, assemble, solve_assembled
from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.surface import ContactSurface
from contact_locking.running.assembly import StudyProblem
from contact_locking.supports.conditions import Constraints

pytestmark = pytest.mark.serial

_PUSH = -0.02


def _clamped_at_the_side(n: float) -> StudySolution:
    """A block that is clamped on its left, with a plate on top that a force pushes down."""
    contact: dict[str, Any] = {
        "on": "top",
        "foundation": {
            "half_space": {"point": [0.0, 1.0], "normal": [0.0, -1.0]},
            "force": [0.0, _PUSH],
        },
        "friction": {"coefficient": 0.5, "smoothing": {"kernel": "none"}},
    }
    loads = {"displacements": [{"on": "left", "value": [0.0, 0.0]}]}
    found = solved(block(h=0.25, loads=loads, contact=contact, penalty__n=n))
    return found


@pytest.mark.parametrize("n", [100.0, 1e4, math.inf])
def test_the_forces_that_are_told_balance_a_tool_over_a_held_corner(n: float) -> None:
    found = _clamped_at_the_side(n)
    entry = found.summary["contacts"][0]
    total = np.add(entry["contact_force"], entry["friction_force"])
    assert total[1] == pytest.approx(_PUSH, rel=1e-6)
    assert found.summary["reactions"]["left"][1] == pytest.approx(-_PUSH, rel=1e-6)
    fields = found.contacts[0]
    is_held = ~fields.free
    assert np.all(fields.pressure[is_held] == 0.0)
    assert np.all(fields.traction[is_held] == 0.0)


def _guided(kernel: str = "convolution", n: float = math.inf, **changes: Any) -> StudyProblem:
    """A block that rubs on its foundation, and whose lower left corner slides at a fixed height."""
    contact: dict[str, Any] = {
        "on": "bottom",
        "friction": {"coefficient": 0.5, "smoothing": {"kernel": kernel, "radius": 0.5}},
    }
    loads = {
        "tractions": [{"on": "top", "value": [0.004, -0.03]}],
        "displacements": [
            {"on": "left", "value": [None, 0.0]},
            {"on": "right", "value": [0.0, None]},
        ],
    }
    changes |= {"material__locking_limit": math.inf, "penalty__n": n}
    parameters = block(h=0.25, loads=loads, contact=contact, **changes)
    return assemble(parameters, MPI.COMM_WORLD)


@pytest.mark.parametrize("kernel", ["convolution", "helmholtz"])
def test_every_method_leaves_a_held_node_that_slides_without_friction(kernel: str) -> None:
    forces = []
    for method, n in (("penalty", 1e6), ("interior_point", 1e6), ("interior_point", math.inf)):
        found = solve_assembled(_guided(kernel, n=n, solver__method=method))
        assert found.converged, found.summary["reason"]
        (fields,) = found.contacts
        assert np.all(fields.bound[~fields.free] == 0.0)
        assert np.all(fields.traction[~fields.free] == 0.0)
        entry = found.summary["contacts"][0]
        forces.append([*entry["contact_force"], *entry["friction_force"]])
    newton, penalised, exact = forces
    assert newton == pytest.approx(penalised, rel=1e-6, abs=1e-9)
    assert newton == pytest.approx(exact, rel=1e-3, abs=1e-9)


def _every_node_is_free(surface: ContactSurface, normal: FloatArray, _: Constraints) -> BoolArray:
    return np.ones(len(normal), dtype=bool)


def _one_more_node_is_held(
    surface: ContactSurface, normal: FloatArray, constraints: Constraints
) -> BoolArray:
    found = _free_nodes(surface, normal, constraints)
    return found & (np.abs(surface.points[:, 0] - 0.5) > 1e-9)


_free_nodes = ContactSurface.free_nodes


@pytest.mark.parametrize("method", ["penalty", "interior_point"])
@pytest.mark.parametrize(
    ("mask", "caught"),
    [(_every_node_is_free, "held_nodes"), (_one_more_node_is_held, "contact_violation")],
)
def test_a_wrong_mask_of_the_solver_is_caught_by_the_certificate(
    mask: Any, caught: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ContactSurface, "free_nodes", mask)
    found = solve_assembled(_guided(n=1e4, solver__method=method))
    criteria = found.summary["certificate"]["criteria"]
    assert not criteria[caught]["holds"] and not found.converged
