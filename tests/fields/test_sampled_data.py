"""Data between the points at which a problem uses them: narrow loads, jumps, spikes and poles."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from problems import block

from contact_locking import InputError
from contact_locking.fem.compiled import assembled
from contact_locking.problem import forms
from contact_locking.study.assembly import StudyProblem, assemble

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
    assert problem.warnings == []
    assert _weight(problem) == pytest.approx(weight, rel=0.03)
    problem.close()


@pytest.mark.parametrize("degree", [1, 2])
def test_a_body_force_narrower_than_a_cell_has_the_right_resultant(degree: int) -> None:
    force = "-exp(-((x - 0.43)**2 + (y - 0.6)**2)/0.01**2)"
    problem = _loaded(degree=degree, body_force=[0.0, force])
    assert problem.warnings == []
    assert _weight(problem) == pytest.approx(math.pi * 1e-4, rel=0.02)
    problem.close()


def test_a_load_narrower_than_a_triangle_has_the_right_resultant() -> None:
    load = "exp(-((x - 0.4)**2 + (y - 0.6)**2)/0.05**2)"
    problem = _loaded(0.5, 3, tractions=_down(load, 3))
    assert _weight(problem) == pytest.approx(math.pi * 0.05**2, rel=0.02)
    problem.close()


def test_a_narrow_load_that_comes_later_has_the_right_resultant_then() -> None:
    load = "t*exp(-((x - 0.3*t)/0.005)**2)"
    held = {"displacements": _HELD, "tractions": _down(load)}
    problem = _block(0.25, loads=held, steps={"times": [0, 1, 2]})
    problem.advance(2.0)
    assert _weight(problem) == pytest.approx(2.0 * 0.005 * math.sqrt(math.pi), rel=0.03)
    problem.close()


def test_a_smooth_load_keeps_the_plain_rule_of_integration() -> None:
    problem = _loaded(tractions=_down("sin(5*x)"), body_force=[0.0, "cos(x*y)"])
    rules = [measure.metadata() for _, measure in problem.loads.terms]
    assert all("quadrature_rule" not in rule for rule in rules)
    problem.close()


def test_a_load_of_which_a_part_is_lost_is_warned_of_with_its_size() -> None:
    problem = _loaded(tractions=_down("1 if abs(x - 0.43) < 0.003 else 0"))
    (warning,) = problem.warnings
    assert warning.startswith("loads.tractions.0.value: changes too sharply for this mesh near x =")
    assert "its resultant is uncertain by about" in warning and "%" in warning
    problem.close()


@pytest.mark.parametrize("centre", [0.4032, 0.43, 0.6, 0.7773])
def test_two_rules_that_agree_by_chance_hide_no_lost_load(centre: float) -> None:
    """Both may see the same share of a band that is a few of their points wide."""
    problem = _loaded(tractions=_down(f"1 if abs(x - {centre}) < 0.0046 else 0"))
    off = abs(_weight(problem) / 0.0092 - 1.0)
    assert off < 0.03 or "its resultant is uncertain" in problem.warnings[0]
    problem.close()
    thinner = f"1 if abs(x - {centre}) < 0.0023135 else 0"
    try:
        told = _loaded(tractions=_down(thinner)).warnings[0]
    except InputError as error:
        told = str(error)
    assert "its resultant is uncertain by about" in told


@pytest.mark.parametrize("load", ["exp(-((x - 0.43)/0.0003)**2)", "1 if abs(x-0.43)<2e-4 else 0"])
def test_a_load_that_is_mostly_lost_is_refused(load: str) -> None:
    with pytest.raises(InputError, match="its resultant is uncertain by about") as caught:
        _loaded(tractions=_down(load))
    assert caught.value.key == "loads.tractions.0.value"


def test_a_load_that_falls_between_all_points_is_warned_of() -> None:
    problem = _loaded(tractions=_down("1 if abs(x - 0.5) < 1e-5 else 0"))
    (warning,) = problem.warnings
    assert warning.startswith("loads.tractions.0.value: is zero at all points")
    problem.close()


_POLES: dict[str, tuple[str, Any, str]] = {
    "a gap": ("contact__gap", "1/(x - 0.23)", "contact.gap"),
    "a small pole of a gap": ("contact__gap", "0.1 + 1e-3/(x - 0.23)", "contact.gap"),
    "friction": ("friction__coefficient", "0.3/abs(x - 0.5)", "friction.coefficient"),
    "friction at a node": ("friction__coefficient", "0.3/abs(x - 0.39)", "friction.coefficient"),
    "a limit": ("material__locking_limit", "0.02/abs(x - 0.5)", "material.locking_limit"),
    "an elasticity": (
        "material__elasticity",
        {"young": "1/(y - 0.31)**2", "poisson": 0.3},
        "material.elasticity.young",
    ),
    "a displacement": (
        "loads",
        {"displacements": [*_HELD, {"on": "top", "value": [None, "x/(x - 0.47)"]}]},
        "loads.displacements.1.value.1",
    ),
    "a traction at a corner": (
        "loads",
        {"displacements": _HELD, "tractions": _down("0.05/x")},
        "loads.tractions.0.value",
    ),
    "a traction": (
        "loads",
        {"displacements": _HELD, "tractions": _down("tan(pi*x)")},
        "loads.tractions.0.value",
    ),
    "a body force": (
        "loads",
        {"displacements": _HELD, "body_force": [0.0, "1e-3/((x - 0.4)**2 + (y - 0.3)**2)"]},
        "loads.body_force",
    ),
}


@pytest.mark.parametrize("name", _POLES)
def test_a_pole_between_the_points_in_use_is_refused_with_its_place(name: str) -> None:
    where, value, key = _POLES[name]
    changes: dict[str, Any] = {where: value}
    with pytest.raises(InputError, match="grows without bound near x = 0") as caught:
        _block(**changes)
    assert caught.value.key == key


@pytest.mark.parametrize("load", ["0.05/sqrt(x)", "-0.05*log(x)"])
def test_a_load_that_grows_slowly_towards_a_point_is_no_pole(load: str) -> None:
    problem = _loaded(tractions=_down(load))
    right = {"0.05/sqrt(x)": 0.1, "-0.05*log(x)": 0.05}[load]
    assert _weight(problem) == pytest.approx(right, rel=0.02)
    problem.close()


_JUMPS: dict[str, tuple[str, Any, str, str]] = {
    "a gap": ("contact__gap", "0.01 if x < 0.43 else 0", "contact.gap", "facet"),
    "a wavy gap": ("contact__gap", "0.01*cos(40*x)", "contact.gap", "facet"),
    "friction": (
        "friction__coefficient",
        "0.3 if x < 0.43 else 0.1",
        "friction.coefficient",
        "facet",
    ),
    "friction in a spot": (
        "friction__coefficient",
        "0.3*exp(-((x - 0.5)/0.01)**2)",
        "friction.coefficient",
        "facet",
    ),
    "a limit": (
        "material__locking_limit",
        "0.02 if x < 0.47 else 0.1",
        "material.locking_limit",
        "cell",
    ),
    "a limit in a layer": (
        "material__locking_limit",
        "0.02 - 0.019*exp(-((y - 0.5)/0.01)**2)",
        "material.locking_limit",
        "cell",
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
    (warning,) = problem.warnings
    assert warning.startswith(f"{key}: changes from ")
    assert f"inside a {entity} near x = 0." in warning and "refine the mesh there" in warning
    assert ("to inf" in warning) == (name == "a limit in a half")
    problem.close()


def test_friction_in_a_spot_at_a_node_is_warned_of() -> None:
    """The node stands for its neighbourhood, where there is no friction."""
    problem = _block(0.25, friction__coefficient="0.3*exp(-((x - 0.5)/1e-4)**2)")
    (warning,) = problem.warnings
    assert warning.startswith("friction.coefficient: its mean is ")
    problem.close()


@pytest.mark.parametrize(
    "changes",
    [
        {"contact__gap": "0.01*x*x"},
        {"friction__coefficient": "0.1 + 0.3*x"},
        {"friction__coefficient": "0.6 - 0.4*s/(s + 0.01)"},
        {"friction__coefficient": "0.3 if x < 0.4 else 0.1"},
        {"material__locking_limit": "0.01 + 0.09*y"},
        {"material__locking_limit": "0.02 if x < 0.4 else 0.1"},
        {"material__locking_limit": "0.02 if x < 0.4 else inf"},
        {"material__locking_limit": "0.02 + 0.01*sin(6*x)"},
    ],
)
def test_data_that_the_mesh_sees_are_not_warned_of(changes: dict[str, Any]) -> None:
    """Slopes, bends, and jumps at nodes and between cells."""
    problem = _block(**changes)
    assert problem.warnings == []
    problem.close()


def test_friction_in_a_spot_that_comes_with_the_slip_is_warned_of() -> None:
    problem = _block(friction__coefficient="0.3*s/(s + 1e-3)*(1 if x < 0.43 else 0)")
    (warning,) = problem.warnings
    assert warning.startswith("friction.coefficient: changes from 0 to 0.15 inside a facet")
    problem.close()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("floor", "share"), [(0.0, None), (0.02, 7.0), (0.4, 0.0)])
def test_a_table_over_a_coordinate_with_a_peak_between_the_nodes_is_told(
    floor: float, share: float | None, degree: int, comm: MPI.Intracomm, tmp_path: Path
) -> None:
    """In a load the table counts at the nodes, of which none sees the peak."""
    folder = comm.bcast(tmp_path)
    if comm.rank == 0:
        rows = [(0, 0), (0.3, 0), (0.37, 0.02), (0.45, 0), (1, 0)]
        text = "".join(f"{x},{floor + height}\n" for x, height in rows)
        (folder / "load.csv").write_text("x,p\n" + text)
    comm.barrier()
    given = block(
        h=0.25,
        mesh__structured=True,
        discretisation__degree=degree,
        friction__smoothing__radius=0.6,
        loads={"displacements": _HELD, "tractions": _down("p(x)")},
        tables={"p": {"file": str(folder / "load.csv"), "over": "x", "column": "p"}},
    )
    if share is None:
        with pytest.raises(InputError, match="its table counts at the nodes alone"):
            assemble(given, comm)
        return
    problem = assemble(given, comm)
    assert len(problem.warnings) == (share > 0.0)
    assert all("its table counts at the nodes alone" in text for text in problem.warnings)
    problem.close()


_PULSE = "1 if abs(t - 0.6) < 0.02 else 0"


@pytest.mark.parametrize(
    ("loads", "contact", "key"),
    [
        ({"tractions": _down(_PULSE)}, {}, "loads.tractions.0.value.1"),
        ({"pressures": [{"on": "top", "value": f"x*({_PULSE})"}]}, {}, "loads.pressures.0.value"),
        ({}, {"gap": f"-0.01*({_PULSE})"}, "contact.gap"),
    ],
)
def test_a_pulse_between_two_steps_is_warned_of(
    loads: dict[str, Any], contact: dict[str, Any], key: str
) -> None:
    def warnings(times: list[float]) -> list[str]:
        problem = _block(
            loads={"displacements": _HELD} | loads,
            contact={"on": "bottom"} | contact,
            steps={"times": times},
        )
        problem.close()
        return problem.warnings

    (warning,) = warnings([0.25, 0.5, 0.75, 1.0])
    assert warning.startswith(f"{key}: its mean is ") and "from 0.5 to 0.75; add the" in warning
    assert warnings([0.25, 0.5, 0.6, 0.75, 1.0]) == []


@pytest.mark.parametrize("law", ["sin(pi*t)", "t", "exp(-((x - t)/0.2)**2)", "cos(9*t)"])
def test_data_that_the_steps_see_are_not_warned_of(law: str) -> None:
    """Waves with some steps each, and loads that travel."""
    problem = _block(
        loads={"displacements": _HELD, "tractions": _down(law)}, steps={"to": 1, "count": 8}
    )
    assert problem.warnings == []
    problem.close()


def test_a_peak_of_a_table_over_the_time_is_found_in_its_rows(
    comm: MPI.Intracomm, tmp_path: Path
) -> None:
    folder = comm.bcast(tmp_path)
    if comm.rank == 0:
        (folder / "load.csv").write_text("t,p\n0,0\n0.41,0.1\n0.4101,1\n0.4102,0.1\n1,0.1\n")
    comm.barrier()
    problem = _block(
        loads={"displacements": _HELD, "tractions": _down("p(t)")},
        tables={"p": {"file": str(folder / "load.csv"), "over": "t", "column": "p"}},
        steps={"to": 1, "count": 4},
    )
    (warning,) = problem.warnings
    assert "its mean is -1 at t = 0.4101, which no step sees" in warning
    problem.close()


def test_a_rotation_whose_mean_is_rounding_has_no_peak() -> None:
    problem = _block(
        mesh__size=[3.0, 0.7],
        loads={
            "displacements": [{"on": "top", "value": ["-0.01*(y - 0.35)*t", "0.01*(x - 1.5)*t"]}]
        },
        steps={"times": [1.0, 1.5, 2.0]},
    )
    assert not problem.warnings
    problem.close()


@pytest.mark.parametrize(
    ("contact", "friction", "told"),
    [
        ({"on": []}, 0.3, "friction.coefficient: has no effect, as contact.on is empty"),
        ([], "0.1*x", "friction.coefficient: has no effect, as contact is empty"),
        ([{"on": "bottom"}, {"on": []}], 0.3, ""),
        ({"on": []}, 0, ""),
        (
            [{"on": "bottom"}, {"on": [], "friction": {"coefficient": 0.2}}],
            0.3,
            "contact.1.friction.coefficient: has no effect, as contact.1.on is empty",
        ),
    ],
)
def test_friction_without_contact_is_warned_of(contact: Any, friction: Any, told: str) -> None:
    problem = _block(
        contact=contact, friction__coefficient=friction, loads={"displacements": _HELD}
    )
    assert [text.startswith(told) for text in problem.warnings] == [True] * bool(told)
    problem.close()


def test_two_contacts_on_one_part_warn_of_their_radius_once() -> None:
    problem = _block(
        contact=[{"on": "bottom"}, {"on": "bottom", "gap": 1}], friction__smoothing__radius=0.01
    )
    (warning,) = problem.warnings
    assert warning.startswith("friction.smoothing.radius: ")
    problem.close()


def test_values_that_are_no_numbers_at_single_points_are_passed_over() -> None:
    problem = _block(material__locking_limit="0.02*(1 + abs(x - 0.5)/abs(x - 0.5))")
    assert problem.warnings == []
    assert np.allclose(problem.limits.limit.x.array, 0.04)
    problem.close()
