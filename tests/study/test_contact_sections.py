"""`contact` in the study file: one section for Gamma_C, or a list with a section for each part."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from problems import block

from contact_locking.contact.contact import Coulomb, Mollifier
from contact_locking.errors import InputError
from contact_locking.running.solving import solve
from contact_locking.study_file import dump, from_mapping, load, problem_fingerprint

pytestmark = pytest.mark.serial

FLOOR_AND_WALL = """\
mesh: {builder: block}
contact:
  - on: bottom
    gap: 0.01
  - on: [left, right]
    foundation: {sphere: {centre: [-3, 0.5], radius: 2}}
    friction:
      coefficient: 0.6
      smoothing: {kernel: none}
friction:
  coefficient: 0.3 + s
  smoothing: {radius: 0.2}
  regularisation: 1.0e-4
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "study.yml"
    path.write_text(FLOOR_AND_WALL)
    return path


def test_one_section_is_one_part_with_the_common_friction() -> None:
    given = from_mapping({"contact": {"on": "top", "gap": "x"}, "friction": {"coefficient": 0.2}})
    (part,) = given.contacts
    assert (part.key, part.on, part.gap.data) == ("contact", ("top",), "x")
    assert part.friction == given.friction
    assert given.contact_names == ("top",)


def test_a_part_takes_from_the_common_friction_what_it_does_not_say(file: Path) -> None:
    floor, wall = load(file).parameters.contacts
    assert floor.friction == Coulomb(
        coefficient="0.3 + s", smoothing=Mollifier(radius=0.2), regularisation=1e-4
    )
    assert wall.friction == Coulomb(
        coefficient=0.6, smoothing=Mollifier(kernel="none", radius=0.2), regularisation=1e-4
    )


def test_a_study_varies_the_parts_by_their_number(file: Path) -> None:
    text = "study: {vary: {contact.1.friction.coefficient: [0, 1], contact.0.gap: [0, 0.1]}}"
    file.write_text(FLOOR_AND_WALL + text)
    study = load(file)
    assert study.parameters.study is not None
    cases = [study.case(case).contacts for case in study.parameters.study.cases()]
    found = [
        (float(str(wall.friction and wall.friction.coefficient)), float(floor.gap))
        for floor, wall in cases
    ]
    assert found == [(0.0, 0.0), (0.0, 0.1), (1.0, 0.0), (1.0, 0.1)]


@pytest.mark.parametrize("override", ["contact=[]", "contact={gap: 1}", "title=two foundations"])
def test_a_dump_keeps_the_parts_as_the_file_has_them(file: Path, override: str) -> None:
    parameters = load(file, [override]).parameters
    file.write_text(dump(parameters))
    assert load(file).parameters == parameters


def test_the_fingerprint_tells_problems_apart_and_not_the_ways_to_write_them() -> None:
    def of(contact: Any, friction: Any = None) -> str:
        return problem_fingerprint(from_mapping({"contact": contact, "friction": friction}))

    one = of({"gap": 0.1}, {"coefficient": 0.3})
    assert one == of([{"gap": 0.1}], {"coefficient": 0.3})
    assert one == of({"gap": 0.1, "friction": {"coefficient": 0.3}}, {"coefficient": 0.7})
    assert one != of({"gap": 0.1}, {"coefficient": 0.7})
    two = [{"gap": 0.1}, {"on": "left", "friction": {"coefficient": 0.3}}]
    assert len({one, of(two), of(two[::-1]), of(two, {"coefficient": 0.3}), of([])}) == 5


def test_contact_may_be_held_along_its_surface_and_not_across() -> None:
    """It slides on the foundation as it is moved, and the reaction holds it against friction."""

    def solved(*value: float | None) -> Any:
        held = [{"on": "top", "value": [0, -0.02]}, {"on": "bottom", "value": value}]
        changes: dict[str, Any] = {
            "loads": {"displacements": held},
            "friction__smoothing": {"kernel": "none"},
        }
        parameters = block(h=0.5, material__locking_limit=math.inf, penalty__n=math.inf, **changes)
        return solve(parameters).summary

    found = solved(0.01, None)
    (friction, _), (_, pressed) = found["friction_force"], found["contact_force"]
    assert pressed > 0.01 and friction == pytest.approx(-0.3 * pressed, rel=1e-4)
    assert sum(force[0] for force in found["reactions"].values()) == pytest.approx(-friction)
    with pytest.raises(InputError, match="displacement across it"):
        solved(None, 0.0)
