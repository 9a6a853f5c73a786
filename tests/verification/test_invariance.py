"""An answer does not know units, position, numbering or names: it is the same but for rounding.

A solution is sought until the duality gap is 1e-8 of the energy.  Two ways to such a solution may
end 1e-4 apart in the energy norm, some 1e-6 in practice.  But a transformed problem is walked
through by the same steps, apart from their rounding, and ends at the same iterate: answers agree to
1e-7 of the largest value, in practice to 1e-9.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
from answers import Answer, Block, answer_of, rotation, told
from block_problems import (
    ALL,
    IDLE,
    PROPORTIONAL,
    TURNABLE,
    Make,
    corner,
    locking,
    pressed_builder,
    proportional_local,
)
from mpi4py import MPI
from slow import slow
from sweep.transforms import Transform

from contact_locking.mesh import domain
from contact_locking.mesh.file.data import MeshData
from contact_locking.mesh.file.gmsh_model import extract
from contact_locking.meshes import empty_model
from contact_locking.process import solving
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters

Reference = Callable[[Make, int], Answer]

AGREEMENT = 1e-7
BLOCKS = {2: Block.unit(2, 5), 3: Block.unit(3, 3)}
FINER = {2: 24, 3: 7}
DIMS = pytest.mark.parametrize("dim", [2, 3])


def names(value: Any) -> str:
    return value.__name__ if callable(value) else str(value)


@pytest.fixture(autouse=True, scope="module")
def gmsh_in_this_process() -> Iterator[None]:
    """A process for each file, which may crash it, would take longer than the solve."""

    def read(path: Path) -> MeshData:
        with empty_model() as model:
            gmsh.merge(str(path))
            return extract(model, str(path))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(domain, "read", read)
        yield


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    """The answer to a problem as it is; solved once."""
    folder = tmp_path_factory.mktemp("reference")

    @cache
    def solved(make: Make, dim: int) -> Answer:
        answer = answer_of(make(dim), BLOCKS[dim], folder / "body.msh")
        assert answer.verdicts["converged"]
        return answer

    return solved


@pytest.mark.serial
@DIMS
@pytest.mark.parametrize("make", [*ALL, *PROPORTIONAL], ids=names)
def test_each_problem_presses_and_locks_where_it_has_a_limit(
    reference: Reference, make: Make, dim: int
) -> None:
    answer = reference(make, dim)
    limit = make(dim)["material"]["locking_limit"]
    assert answer.fields["pressure"].max() > 1e-3
    assert (np.abs(answer.fields["locking_force"]).max() > 1e-4) == (limit != math.inf)


@pytest.mark.serial
@DIMS
@pytest.mark.parametrize("make", ALL, ids=names)
@pytest.mark.parametrize(
    ("length", "stress"), [(1e-9, 1e12), (1e9, 1e-12), slow(1e-9, 1e-12), slow(1e9, 1e12)]
)
def test_units_of_length_and_stress_change_the_answer_by_rounding_only(
    reference: Reference, make: Make, dim: int, length: float, stress: float, tmp_path: Path
) -> None:
    units = Transform.of(np.eye(dim), length, stress)
    found = answer_of(make(dim), BLOCKS[dim], tmp_path / "body.msh", units)
    reference(make, dim).require_same(found, AGREEMENT)


@DIMS
@pytest.mark.parametrize(("length", "stress"), [slow(1e-9, 1e12), slow(1e9, 1e-12), (1e3, 1e15)])
def test_an_iterative_solver_knows_no_units_either(
    dim: int, length: float, stress: float, tmp_path: Path
) -> None:
    # The blocks of the other tests are too small for multigrid to coarsen.
    data = locking(dim) | {"solver": {"linear": "iterative"}}
    grid, path = Block.unit(dim, FINER[dim]), tmp_path / "body.msh"
    expected, units = answer_of(data, grid, path), Transform.of(np.eye(dim), length, stress)
    expected.require_same(answer_of(data, grid, path, units), AGREEMENT)
    assert expected.verdicts["converged"]


@DIMS
@pytest.mark.parametrize("make", PROPORTIONAL, ids=names)
@pytest.mark.parametrize(
    ("load", "length", "stress"), [(1e-30, 1.0, 1.0), (1e-10, 1e9, 1e-12), (1e-30, 1e-9, 1e12)]
)
def test_the_displacement_is_proportional_to_the_loads_where_nothing_has_a_size(
    reference: Reference,
    make: Make,
    dim: int,
    load: float,
    length: float,
    stress: float,
    tmp_path: Path,
) -> None:
    size = replace(Transform.of(np.eye(dim), length, stress), load=load)
    found = answer_of(make(dim), BLOCKS[dim], tmp_path / "body.msh", size)
    reference(make, dim).require_same(found, AGREEMENT)


MIRROR = {2: np.diag([-1.0, 1.0]), 3: np.diag([-1.0, 1.0, 1.0])}
QUARTER = {2: np.array([[0.0, -1.0], [1.0, 0.0]]), 3: np.eye(3)[[2, 0, 1]]}
ANY = {2: rotation(0.7), 3: rotation(0.7, -1.1, 2.3)}
POSITIONS = [
    (name, make)
    for name, makes in {"mirrored": ALL, "by 90 degrees": ALL, "by any angle": TURNABLE}.items()
    for make in makes
]


@pytest.mark.serial
@DIMS
@pytest.mark.parametrize(("position", "make"), POSITIONS, ids=names)
def test_a_mirrored_or_rotated_problem_has_the_mirrored_or_rotated_answer(
    reference: Reference, position: str, make: Make, dim: int, tmp_path: Path
) -> None:
    Q = {"mirrored": MIRROR, "by 90 degrees": QUARTER, "by any angle": ANY}[position][dim]
    found = answer_of(make(dim), BLOCKS[dim], tmp_path / "body.msh", Transform.of(Q))
    reference(make, dim).require_same(found, AGREEMENT)


def test_the_default_radius_of_r_does_not_depend_on_the_position(tmp_path: Path) -> None:
    """It is a share of the extent of Gamma_C, here of two sides."""
    block, found = Block.unit(2, 30), []
    for place in (Transform.of(np.eye(2)), Transform.of(rotation(0.25 * math.pi))):
        data = place.study(corner()) | {"mesh": {"file": str(tmp_path / "body.msh")}}
        block.write(tmp_path / "body.msh", place)
        made = assemble(Parameters.model_validate(data), MPI.COMM_WORLD)
        (contact,) = made.contacts
        x = contact.surface.points @ place.matrix
        smoothed = contact.friction.smoothing.apply((x[:, 0] > 0.5) * (1.0 + x[:, 1] ** 2))
        found.append(MPI.COMM_WORLD.allreduce(contact.surface.weights @ (x[:, 0] * smoothed)))
        made.close()
    assert found[1] == pytest.approx(found[0], rel=1e-9)


@DIMS
@pytest.mark.parametrize("make", [*ALL, proportional_local], ids=names)
def test_the_numbering_of_nodes_and_elements_does_not_matter(
    reference: Reference, make: Make, dim: int, tmp_path: Path
) -> None:
    block = BLOCKS[dim].renumbered(np.random.default_rng(5))
    found = answer_of(make(dim), block, tmp_path / "body.msh")
    reference(make, dim).require_same(found, AGREEMENT)


@DIMS
@pytest.mark.parametrize("make", [*ALL, proportional_local], ids=names)
def test_names_tags_and_the_order_of_entries_do_not_matter(
    reference: Reference, make: Make, dim: int, tmp_path: Path
) -> None:
    block = BLOCKS[dim]
    labels = {name: f"group {i * 7 % 11} of {name[::-1]}" for i, name in enumerate(block.groups)}
    found = answer_of(reordered(make(dim), labels), block.relabelled(labels), tmp_path / "body.msh")
    reference(make, dim).require_same(found, AGREEMENT)


def reordered(given: Any, labels: dict[str, str]) -> Any:
    """Sections and lists of entries in the other order, with the other names."""
    if isinstance(given, dict):
        return {
            labels.get(key, key): reordered(value, labels) for key, value in reversed(given.items())
        }
    if isinstance(given, list) and given and isinstance(given[0], dict):
        return [reordered(entry, labels) for entry in reversed(given)]
    return labels.get(given, given) if isinstance(given, str) else given


MATERIALS = {
    "steel in megapascals and millimetres": (1e-6, 1e3),
    "steel in gigapascals and micrometres": (1e-9, 1e6),
    "rubber in pascals and metres": (1e6 / 2.1e11, 1.0),
}


@pytest.mark.serial
@DIMS
@pytest.mark.parametrize("material", MATERIALS)
def test_the_defaults_are_right_in_any_unit(dim: int, material: str) -> None:
    """Steel in pascals and metres, where nothing is said of penalties, and the same elsewhere."""
    steel = _answer(pressed_builder(dim), Transform.of(np.eye(dim)))
    stress, length = MATERIALS[material]
    units = Transform.of(np.eye(dim), length, stress)
    data = units.study(pressed_builder(dim))
    for key in ("h", "size"):
        data["mesh"][key] = (length * np.array(data["mesh"][key])).tolist()
    found = _answer(data, units)
    steel.require_same(found, AGREEMENT)
    asked = pressed_builder(dim) | {"penalty": {"n": math.inf}}
    steel.require_same(_answer(asked, Transform.of(np.eye(dim))), AGREEMENT)
    assert steel.verdicts["converged"]
    assert steel.numbers["contact_force"][-1] > 1e5


def _answer(data: Any, units: Transform) -> Answer:
    return told(solving.solve(Parameters.model_validate(data)), units)


@pytest.mark.serial
@DIMS
@pytest.mark.parametrize(("length", "stress"), [(1.0, 1.0), (1e-9, 1e12), (1e9, 1e-12)])
@pytest.mark.parametrize("make", IDLE, ids=names)
def test_nothing_to_do_is_done_in_one_tangent_in_any_unit(
    make: Make, dim: int, length: float, stress: float, tmp_path: Path
) -> None:
    units = Transform.of(np.eye(dim), length, stress)
    found = answer_of(make(dim), BLOCKS[dim], tmp_path / "body.msh", units)
    assert found.verdicts["converged"]
    assert all(holds is not False for holds in found.verdicts["criteria"].values())
    assert found.tangents == 1
    assert np.abs(found.numbers["contact_force"]).max() == 0.0
    assert np.abs(found.numbers["friction_force"]).max() == 0.0
    assert found.numbers["strain_norm_max"][0] < 1e-13
