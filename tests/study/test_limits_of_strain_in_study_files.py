"""Limits of the strain in study files: what is refused, by which key, and what is read back."""

from __future__ import annotations

from typing import Any

import pytest
from limits_of_strain import SEVERAL, material
from mpi4py import MPI
from ruamel.yaml import YAML

from contact_locking.errors import InputError
from contact_locking.study.assembly import assemble
from contact_locking.study_file import dump, from_mapping

pytestmark = pytest.mark.serial


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


def test_a_list_of_limits_is_written_and_read_back() -> None:
    given = from_mapping({"material": {"locking": SEVERAL}})
    again = from_mapping(YAML(typ="safe").load(dump(given)))
    assert again == given
