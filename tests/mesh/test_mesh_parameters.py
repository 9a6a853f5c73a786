"""The parameters of the geometries: what is refused, before Gmsh is even imported."""

import math
from typing import Any

import pytest

from contact_locking.meshes import BUILDERS

pytestmark = pytest.mark.serial


@pytest.mark.parametrize("name", BUILDERS)
@pytest.mark.parametrize("key", ["h", "h_contact"])
def test_impossible_element_sizes_are_refused(name: str, key: str) -> None:
    bad: Any
    for bad in (0, -1, math.nan, math.inf, 1e-9, 1e60, "0.1", True, [0.1]):
        with pytest.raises(ValueError, match=f"^{key}: "):
            BUILDERS[name](**{key: bad})


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("block", {"dim": 1}, "dim: must be 2 or 3"),
        ("block", {"dim": True}, "dim: must be 2 or 3"),
        ("block", {"dim": "2"}, "dim: must be 2 or 3"),
        ("block", {"dim": 3, "size": [1, 1]}, "size: must be a list of 3 numbers in 3D"),
        ("block", {"size": 1.0}, "size: must be a list of 2 numbers"),
        ("block", {"size": "11"}, "size: must be a list of 2 numbers"),
        ("block", {"size": [1, -1]}, "size: must be positive"),
        ("block", {"size": [1, math.nan]}, "size: must be finite"),
        ("block", {"size": [1, 0.05]}, "h: 0.1 is more than the thickness of the body, 0.05"),
        ("block", {"h_contact": 0.2}, "h_contact: 0.2 is more than h, 0.1"),
        ("block", {"structured": 1}, "structured: must be true or false"),
        ("block", {"structured": True, "h_contact": 0.05}, "h_contact: a structured block"),
        ("block", {"h": 1e-4}, "h: 0.0001 would make about 2e\\+08 cells"),
        ("block", {"h_contact": 2e-5, "dim": 3}, "h_contact: 2e-05 would make about"),
        ("block", {"h": 1e-4, "structured": True}, "h: 0.0001 would make about 2e\\+08 cells"),
        ("stack", {"dim": 3, "structured": True}, "structured: a stack in 3D .* add cells: box"),
        ("stack", {"dim": 3, "cells": "box"}, "cells: box in 3D is for a block or a stack with"),
        ("punch", {"half_width": 1.0}, "half_width: 1 is not less than the width"),
        ("punch", {"dim": 3, "size": [2, 0.2, 1]}, "half_width: 0.25 is not less than"),
        ("punch", {"half_width": 0.05}, "h_contact: 0.1 is more than half_width, 0.05"),
        ("disc", {"radius": -1}, "radius: must be positive"),
        ("disc", {"h": 1.5, "h_contact": 0.1}, "h: 1.5 is more than the thickness"),
        ("disc", {"contact_width": 1.0}, "contact_width: 1 is not less than the radius"),
        ("disc", {"contact_width": 0.05}, "h_contact: 0.1 is more than contact_width, 0.05"),
        ("disc", {"half": False, "quarter": True}, "quarter: .* set half: true"),
        ("disc", {"half": None}, "half: must be true or false"),
        ("ball", {"contact_width": 1e-4}, "contact_width: .* less than a thousandth"),
        ("ball", {"contact_width": 2.0}, "contact_width: 2 is not less than the radius"),
        ("ball", {"h": 0.004}, "h: 0.004 would make about 3e\\+08 cells"),
        (
            "annulus",
            {"outer_radius": 0.5},
            "inner_radius: 1 is not less than the outer",
        ),
        ("annulus", {"inner_radius": 1.95}, "h: 0.1 is more than the thickness"),
        ("l_shape", {"notch": [0.5, 1]}, "notch: .* is not inside the block"),
        ("l_shape", {"notch": [0.5]}, "notch: must be a list of 2 numbers"),
        ("l_shape", {"notch": [0.95, 0.5]}, "h: 0.1 is more than the thickness of the body"),
        ("inclusion", {"centre": [0.2, 0.5]}, "radius: an inclusion .* does not stay inside"),
        ("inclusion", {"radius": 0.5}, "radius: an inclusion .* does not stay inside"),
        ("inclusion", {"radius": 0.05}, "h: 0.1 is more than the radius of the inclusion"),
        ("inclusion", {"dim": 3, "centre": [0.5, 0.5]}, "centre: must be a list of 3 numbers"),
    ],
)
def test_impossible_parameters_are_refused(name: str, given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        BUILDERS[name](**given)
