"""Limits of the strain in study files: what is refused, by which key, and what is read back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from limits_of_strain import SEVERAL, material
from mpi4py import MPI
from ruamel.yaml import YAML

from contact_locking.errors import InputError
from contact_locking.study.assembly import assemble
from contact_locking.study_file import dump, from_mapping

pytestmark = pytest.mark.serial

BAD: dict[str, tuple[Any, str, str]] = {
    "unknown norm": ({"norm": "shear", "at_most": 1}, "0.norm", "must be"),
    "no limit": ({"norm": "volume"}, "0", "limits nothing"),
    "no upper limit": ({"norm": "deviator"}, "0.at_most", "is missing"),
    "zero": ({"norm": "deviator", "at_most": 0}, "0.at_most", "must be > 0"),
    "zero is not inside": ({"norm": "volume", "at_least": 0.001}, "0.at_least", "must be < 0"),
    "lower limit of a norm": (
        {"norm": "strain", "at_most": 1, "at_least": -1},
        "0.at_least",
        "belongs to norm: volume",
    ),
    "no direction": ({"norm": "direction", "at_most": 1}, "0.along", "is missing"),
    "zero direction": (
        {"norm": "direction", "along": [0, 0], "at_most": 1},
        "0.along",
        "zero vector",
    ),
    "long direction": (
        {"norm": "direction", "along": [0, 0, 1], "at_most": 1},
        "0.along",
        "2 components",
    ),
    "no matrix": ({"norm": "weighted", "at_most": 1}, "0.matrix", "is missing"),
    "zero matrix": (
        {"norm": "weighted", "matrix": [[0] * 3] * 3, "at_most": 1},
        "0.matrix",
        "limits nothing",
    ),
    "matrix of 3D": (
        {"norm": "weighted", "matrix": np.eye(6).tolist(), "at_most": 1},
        "0.matrix",
        "3x3 in 2D",
    ),
    "direction of the volume": (
        {"norm": "volume", "at_most": 1, "along": [1, 0]},
        "0.along",
        "belongs to norm: direction",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_set_of_strains_is_refused_with_its_key(name: str) -> None:
    limit, key, message = BAD[name]
    with pytest.raises(InputError) as caught:
        from_mapping({"mesh": {"dim": 2}, "material": {"locking": [limit]}})
    assert f"material.locking.{key}" in str(caught.value)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("limit", "key"),
    [
        ({"norm": "deviator", "at_most": "x - 0.5"}, "at_most"),
        ({"norm": "volume", "at_least": "0.5 - x"}, "at_least"),
        ({"norm": "direction", "along": ["0*x", "0*x"], "at_most": 0.1}, "along"),
        ({"norm": "direction", "along": ["1/0", 1], "at_most": 0.1}, "along.0"),
    ],
)
def test_limits_that_fail_on_the_mesh_are_refused_with_their_key(
    limit: dict[str, Any], key: str
) -> None:
    with pytest.raises(InputError) as caught:
        assemble(from_mapping({"mesh": {"h": 0.3}, "material": material(limit)}), MPI.COMM_WORLD)
    assert f"material.locking.0.{key}" in f"{caught.value.key} {caught.value}"


def test_two_balls_and_a_ball_beside_the_short_form_are_refused() -> None:
    ball = {"norm": "strain", "at_most": 0.1}
    for wrong in (
        {"locking": [ball, ball]},
        {"locking": [ball], "locking_limit": 0.2},
        {"regions": {"body": {"locking": [ball], "locking_limit": 0.2}}},
    ):
        with pytest.raises(InputError, match="locking"):
            from_mapping({"material": wrong})


def test_a_list_of_limits_is_written_and_read_back() -> None:
    given = from_mapping({"material": {"locking": SEVERAL}})
    again = from_mapping(YAML(typ="safe").load(dump(given)))
    assert again == given
