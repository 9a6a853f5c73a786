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
from contact_locking.study import assembly
from contact_locking.study.assembly import assemble

pytestmark = pytest.mark.serial


def _warnings(folder: Path, changes: dict[str, Any]) -> list[str]:
    """The warnings of ``check``."""
    return assembly.check(study_file.load(changed(folder, changes)).parameters)["warnings"]


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


@pytest.mark.parametrize("kernel", ["convolution", "helmholtz"])
def test_the_default_radius_is_not_warned_of_and_smooths(kernel: str, tmp_path: Path) -> None:
    changes = {"friction.smoothing": {"kernel": kernel}, "mesh.h": 0.25}
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


def test_a_filter_with_a_huge_radius_is_the_mean(tmp_path: Path) -> None:
    changes = {"friction.smoothing": {"kernel": "helmholtz", "radius": 1e6}, "mesh.h": 0.1}
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


@pytest.mark.parametrize("moves", [False, True])
def test_a_foundation_at_right_angles_to_the_contact_is_warned_of_unless_it_moves(
    moves: bool, tmp_path: Path
) -> None:
    foundation = {"expression": "x + 1"} | ({"motion": [0, 0]} if moves else {})
    found = _warnings(tmp_path, {"contact": {"on": "bottom", "foundation": foundation}})
    told = [text for text in found if "at right angles" in text]
    assert len(told) == (0 if moves else 1)
    assert all(text.startswith("contact.foundation.expression: ") for text in told)
