"""Data between the points at which a problem uses them: narrow loads, jumps, spikes and poles."""

from __future__ import annotations

import math
from typing import Any

import pytest
import ufl
from mpi4py import MPI
from problems import block

from contact_locking import InputError
from contact_locking.fem.compiled import assembled
from contact_locking.problem import forms
from contact_locking.running.assembly import StudyProblem, assemble

pytestmark = pytest.mark.serial

_HELD = [{"on": "left", "value": [0.0, 0.0]}]


def _block(h: float = 0.2, dim: int = 2, **changes: Any) -> StudyProblem:
    """A regular block; R reaches over several facets."""
    changes = {"mesh__structured": True, "friction__smoothing__radius": 0.6} | changes
    return assemble(block(dim, h, **changes), MPI.COMM_WORLD)


def _loaded(h: float = 0.25, dim: int = 2, degree: int = 1, **loads: Any) -> StudyProblem:
    held = [{"on": "left", "value": [0.0] * dim}]
    return _block(h, dim, discretisation__degree=degree, loads={"displacements": held} | loads)


def _down(load: str, dim: int = 2) -> list[dict[str, Any]]:
    return [{"on": "top", "value": [0.0] * (dim - 1) + [f"-({load})"]}]


def _weight(problem: StudyProblem) -> float:
    """The resultant of the loads downwards, from the forms of the solver."""
    test = ufl.TestFunction(problem.u.function_space)
    forces = assembled(forms.external_work(test, problem.data))
    dofmap, dim = problem.u.function_space.dofmap, problem.domain.dim
    owned = dofmap.index_map.size_local
    return -float(problem.domain.comm.allreduce(forces.reshape(-1, dim)[:owned, -1].sum()))


@pytest.mark.parametrize(
    ("load", "weight"),
    [
        ("exp(-((x - 0.43)/0.005)**2)", 0.005 * math.sqrt(math.pi)),
        ("1 if abs(x - 0.43) < 0.02 else 0", 0.04),
        ("1 if x < 0.3 else 0", 0.3),
        ("sin(5*x)", (1.0 - math.cos(5.0)) / 5.0),
        ("sqrt(x)", 2.0 / 3.0),
    ],
)
@pytest.mark.parametrize("kind", ["tractions", "pressures"])
def test_a_load_narrower_than_a_facet_has_the_right_resultant(
    load: str, weight: float, kind: str
) -> None:
    given: Any = _down(load) if kind == "tractions" else [{"on": "top", "value": load}]
    problem = _loaded(**{kind: given})
    assert problem.findings == []
    assert _weight(problem) == pytest.approx(weight, rel=0.03)
    problem.close()


@pytest.mark.parametrize("degree", [1, 2])
def test_a_body_force_narrower_than_a_cell_has_the_right_resultant(degree: int) -> None:
    force = "-exp(-((x - 0.43)**2 + (y - 0.6)**2)/0.01**2)"
    problem = _loaded(degree=degree, body_force=[0.0, force])
    assert problem.findings == []
    assert _weight(problem) == pytest.approx(math.pi * 1e-4, rel=0.02)
    problem.close()


def test_a_load_of_which_a_part_is_lost_is_warned_of_with_its_size() -> None:
    problem = _loaded(tractions=_down("1 if abs(x - 0.43) < 0.003 else 0"))
    (finding,) = problem.findings
    assert (finding.code, finding.key) == ("load.sharp", "loads.tractions.0.value")
    assert finding.numbers["size"] == 1.0 and 2.0 < finding.numbers["per_cent"] < 100.0
    problem.close()


@pytest.mark.parametrize("load", ["exp(-((x - 0.43)/0.0003)**2)", "1 if abs(x-0.43)<2e-4 else 0"])
def test_a_load_that_is_mostly_lost_is_refused(load: str) -> None:
    with pytest.raises(InputError, match="its resultant is uncertain by about") as caught:
        _loaded(tractions=_down(load))
    assert caught.value.key == "loads.tractions.0.value"


_JUMPS: dict[str, tuple[str, Any, str, str]] = {
    "a gap": ("contact__gap", "0.01 if x < 0.43 else 0", "contact.gap", "facet"),
    "a pole of a gap": ("contact__gap", "0.1 + 1e-3/(x - 0.23)", "contact.gap", "facet"),
    "friction": (
        "friction__coefficient",
        "0.3 if x < 0.43 else 0.1",
        "friction.coefficient",
        "facet",
    ),
    "a limit in a half": (
        "material__locking_limit",
        "0.02 if x < 0.47 else inf",
        "material.locking_limit",
        "cell",
    ),
    "a set of strains": (
        "material",
        {"locking": [{"norm": "deviator", "at_most": "0.02 if x < 0.47 else 0.1"}]},
        "material.locking.0.at_most",
        "cell",
    ),
}


@pytest.mark.parametrize("name", _JUMPS)
def test_a_jump_or_a_spot_inside_of_a_cell_or_facet_is_warned_of_once(name: str) -> None:
    where, value, key, entity = _JUMPS[name]
    changes: dict[str, Any] = {where: value}
    problem = _block(**changes)
    (finding,) = problem.findings
    assert (finding.code, finding.key) == ("data.features", key)
    assert finding.numbers["entity"] == entity and finding.numbers["place"].startswith("x = 0.")
    assert math.isinf(finding.numbers["high"]) == (name == "a limit in a half")
    problem.close()


@pytest.mark.parametrize(
    "changes",
    [
        {"contact__gap": "0.01*x*x"},
        {"friction__coefficient": "0.6 - 0.4*s/(s + 0.01)"},
        {"friction__coefficient": "0.3 if x < 0.4 else 0.1"},
        {"material__locking_limit": "0.01 + 0.09*y"},
        {"material__locking_limit": "0.02 if x < 0.4 else inf"},
    ],
)
def test_data_that_the_mesh_sees_are_not_warned_of(changes: dict[str, Any]) -> None:
    """Slopes, bends, and jumps at nodes and between cells."""
    problem = _block(**changes)
    assert problem.findings == []
    problem.close()
