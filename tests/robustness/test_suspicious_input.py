"""Input that can be solved and is hardly meant: warned of, with the place."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_study import changed
from mpi4py import MPI

from contact_locking import study_file
from contact_locking.command import cli
from contact_locking.fields import plausibility
from contact_locking.monitor import Monitor
from contact_locking.process import solving
from contact_locking.study.assembly import assemble

pytestmark = pytest.mark.serial


def _warnings(folder: Path, changes: dict[str, Any]) -> list[str]:
    """The warnings of ``check``."""
    return solving.check(study_file.load(changed(folder, changes)).parameters)["warnings"]


@pytest.mark.parametrize("load", ["-0.1 if x < 0.3 else 0", "-0.1*sqrt(x)", "-0.1*sin(5*x)"])
def test_jumps_and_bends_of_a_load_are_not_warned_of(load: str, tmp_path: Path) -> None:
    tractions = [{"on": "top", "value": [0, load]}]
    changes = {"mesh.h": 0.15, "loads.tractions": tractions, "loads.body_force": [0, load]}
    assert _warnings(tmp_path, changes) == []


@pytest.mark.parametrize(
    "contact", [{"gap": -1.5}, {"foundation": {"half_space": {"point": [0, 2], "normal": [0, 1]}}}]
)
def test_a_body_wholly_inside_the_foundation_is_warned_of(
    contact: dict[str, Any], tmp_path: Path
) -> None:
    (warning,) = _warnings(tmp_path, {"contact": {"on": "bottom"} | contact})
    assert warning.startswith(f"contact.{next(iter(contact))}: all of the body lies inside")
    assert _warnings(tmp_path, {"contact": {"on": "bottom", "gap": -0.01}}) == []


def test_loads_and_strains_beyond_the_theory_are_warned_of_in_numbers_that_one_can_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Newtons and millimetres beside pascals lead to such loads."""
    changes = {"loads.tractions": [{"on": "top", "value": [0, -5e8]}]}
    words = ["--output", str(tmp_path / "out"), "--quiet", "--set", "output={picture: false}"]
    assert cli.main(["run", str(changed(tmp_path, changes)), *words]) == 0
    errors = capsys.readouterr().err
    assert "loads.tractions.0.value: it reaches 2.6e+08 times the stiffness" in errors
    assert "e+08 times its limit: penalty.n: " in errors
    assert "this theory is of small strains: do the units" in errors
    assert max(map(len, re.findall(r"\d+", errors))) < 4
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [f"warning: {text}" for text in summary["warnings"]] == errors.splitlines()


def test_a_friction_coefficient_below_zero_by_rounding_is_zero(tmp_path: Path) -> None:
    changes = {"friction.coefficient": "0.5*x - 1e-17", "penalty.n": 1e3}
    solution = solving.solve(study_file.load(changed(tmp_path, changes)).parameters, MPI.COMM_SELF)
    assert solution.converged
    assert solution.contact_points is not None
    assert (solution.contact_points.bound >= 0.0).all()


@pytest.mark.parametrize("kernel", ["convolution", "helmholtz"])
@pytest.mark.parametrize("h", [0.5, 0.25, 0.05])
def test_the_default_radius_is_not_warned_of_and_smooths(
    kernel: str, h: float, tmp_path: Path
) -> None:
    changes = {"friction.smoothing": {"kernel": kernel}, "mesh.h": h}
    study = study_file.load(changed(tmp_path, changes))
    made = assemble(study.parameters, MPI.COMM_SELF)
    assert made.warnings == []
    (contact,) = made.contacts
    x = contact.surface.points[:, 0]
    # The value at each node takes part of its neighbours'.
    one = np.where(x == x.max(), 1.0, 0.0)
    smoothed = contact.friction.smoothing.apply(one)
    assert 0.0 < np.sort(smoothed)[-2] < smoothed.max() < 0.9
    made.close()


@pytest.mark.parametrize("radius", [1e3, 1e6, 1e100])
def test_a_filter_with_a_huge_radius_is_the_mean(radius: float, tmp_path: Path) -> None:
    changes = {"friction.smoothing": {"kernel": "helmholtz", "radius": radius}, "mesh.h": 0.05}
    made = assemble(study_file.load(changed(tmp_path, changes)).parameters, MPI.COMM_SELF)
    (contact,) = made.contacts
    surface, smoothing = contact.surface, contact.friction.smoothing
    w = np.exp(surface.points[:, 0])
    # The node at the clamp takes no part.
    held = np.isclose(surface.points[:, 0], 0.0)
    is_free = (~held).astype(float)
    mean = surface.integral(w * is_free) / surface.integral(is_free)
    assert np.abs(smoothing.apply(w) - mean).max() < 1e-6
    assert np.abs(smoothing.apply(np.ones_like(w)) - 1.0).max() < 1e-14
    smoothing.destroy()


@pytest.mark.parametrize("radius", [0.01, 0.25])
def test_radius_not_above_the_mesh_size_is_a_warning_only(
    radius: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = changed(tmp_path, {"friction.smoothing.radius": radius, "mesh.h": 0.25})
    assert cli.main(["check", str(file), "--set", f"output.directory={tmp_path}/out"]) == 0
    warning = capsys.readouterr().err
    assert "friction.smoothing.radius" in warning and "on bottom, so R hardly smooths" in warning


def _pressed_from_above(foundation: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A layer below a ball."""
    return {
        "mesh": {"size": [3, 3], "h": 0.4, "h_contact": 0.05, "axisymmetric": True},
        "material.elasticity": {"young": 1, "poisson": 0.2},
        "loads": {"displacements": [{"on": "bottom", "value": [0, 0]}]},
        "contact": {"on": "top", "foundation": foundation},
        "friction": {"coefficient": 0.2, "smoothing": {"kernel": "none"}},
    } | more


def _ball(height: float, **more: Any) -> dict[str, Any]:
    return {"sphere": {"centre": [0, height], "radius": 1}} | more


def test_friction_on_a_ball_that_is_drawn_at_its_last_place_is_warned_of(tmp_path: Path) -> None:
    """Its friction force is 0.00477, and that of the ball that came there 0.00240."""
    (warning,) = _warnings(tmp_path, _pressed_from_above(_ball(3.94)))
    assert warning.startswith("contact.foundation: it overlaps the body at rest by up to 0.06, ")
    assert "contact.foundation.motion" in warning


@pytest.mark.parametrize(
    "changes",
    [
        _pressed_from_above(_ball(4.0, motion=[0, -0.06])),
        _pressed_from_above(_ball(3.94), friction={"coefficient": 0.0}),
        _pressed_from_above(_ball(3.9999)),
        _pressed_from_above({"half_space": {"point": [0, 2.94], "normal": [0, -1]}}),
        {
            "mesh": {"builder": "annulus", "inner_radius": 1, "outer_radius": 2, "h": 0.3},
            "loads": {"displacements": [{"on": "outer", "value": [0, 0]}]},
            "contact": {
                "on": "inner",
                "foundation": {"cylinder": {"centre": [0, 0], "radius": 1.01}},
            },
        },
    ],
    ids=["it comes there", "without friction", "a touch", "a plane", "a press fit"],
)
def test_other_foundations_with_friction_are_not_warned_of(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    assert _warnings(tmp_path, changes) == []


def test_a_leaf_that_turns_far_is_warned_of_with_the_strain_that_is_neglected(
    tmp_path: Path,
) -> None:
    """By theory without the square of rotations the tip comes down by 60, by elastica by 46.3."""
    changes = {
        "mesh": {"size": [100, 2], "h": 2.0, "structured": True},
        "discretisation": {"degree": 2},
        "material": {"elasticity": {"young": 210000, "poisson": 0.3}, "plane": "stress"},
        "loads": {
            "displacements": [{"on": "left", "value": [0, 0]}],
            "forces": [{"on": "right", "value": [0, "-25.2*t"]}],
        },
        "contact": {"on": "bottom", "gap": 70},
        "friction": {"coefficient": 0.0},
        "steps": {"to": 1, "count": 4},
    }
    told: list[str] = []

    class Listener(Monitor):
        def message(self, text: str) -> None:
            told.append(text)

    study = study_file.load(changed(tmp_path, changes)).parameters
    found = [*solving.solve_steps(study, MPI.COMM_SELF, Listener())]
    turns = [step.summary["rotation_max"] for step in found]
    assert turns == pytest.approx([0.225, 0.45, 0.675, 0.9], rel=0.02)
    assert [len(step.summary["warnings"]) for step in found] == [1] * 4
    (warning,) = [text for text in told if text.startswith("warning")]
    assert "turns by 0.22 rad near (" in warning and "strains of 0.025, " in warning


@pytest.mark.parametrize(("angle", "strain", "count"), [(0.2, 0.01, 1), (0.2, 0.3, 0), (0.1, 0, 0)])
def test_rotations_count_beside_strains(angle: float, strain: float, count: int) -> None:
    assert len(plausibility.about_the_rotation(angle, (0.0, 0.0), strain)) == count


@pytest.mark.parametrize(("strain", "words"), [(0.15, "about 15 %"), (3.0, "do the units")])
def test_strains_above_a_tenth_are_warned_of(strain: float, words: str) -> None:
    assert plausibility.about_the_strain(0.1 + 1e-9) == []
    (warning,) = plausibility.about_the_strain(strain)
    assert words in warning


def test_a_body_that_slides_as_a_whole_turns_by_nothing(tmp_path: Path) -> None:
    moved = {"displacements": [{"on": "left", "value": [5.0, 0.0]}]}
    study = changed(tmp_path, {"loads": moved, "contact": {"on": []}, "friction.coefficient": 0})
    summary = solving.solve(study_file.load(study).parameters, MPI.COMM_SELF).summary
    assert summary["displacement_max"] == pytest.approx(5.0)
    assert summary["rotation_max"] < 1e-9 and summary["warnings"] == []


@pytest.mark.parametrize("moves", [False, True])
def test_a_foundation_at_right_angles_to_the_contact_is_warned_of_unless_it_moves(
    moves: bool, tmp_path: Path
) -> None:
    foundation = {"expression": "x + 1"} | ({"motion": [0, 0]} if moves else {})
    found = _warnings(tmp_path, {"contact": {"on": "bottom", "foundation": foundation}})
    told = [text for text in found if "at right angles" in text]
    assert len(told) == (0 if moves else 1)
    assert all(text.startswith("contact.foundation.expression: ") for text in told)


def test_steps_repeat_no_warning_with_other_numbers(tmp_path: Path) -> None:
    said: list[str] = []

    class Listener(Monitor):
        def message(self, text: str) -> None:
            said.append(text)

    changes = {
        "mesh.h": 0.25,
        "loads.tractions": [{"on": "top", "value": [0, "-5e8*t"]}],
        "steps": {"to": 1, "count": 3},
    }
    parameters = study_file.load(changed(tmp_path, changes)).parameters
    last = solving.solve(parameters, MPI.COMM_WORLD, Listener())
    kinds = [text.partition(" it reaches")[0] for text in said if text.startswith("warning")]
    assert last.summary["warnings"] and len(kinds) == len(set(kinds))
