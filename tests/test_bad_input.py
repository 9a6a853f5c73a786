"""Every mistake people make: one clear message with its place, exit code 2, nothing written."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import gmsh
import pytest
from mpi4py import MPI
from ruamel.yaml import YAML

from contact_locking import cli

pytestmark = pytest.mark.serial

GOOD: dict[str, Any] = {
    "mesh": {"builder": "block", "dim": 2, "size": [1.0, 1.0], "h": 0.25},
    "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
    "loads": {
        "body_force": [0.0, 0.0],
        "tractions": [{"on": "top", "value": [0.03, -0.05]}],
        "displacements": [{"on": "left", "value": [0.0, 0.0]}],
    },
    "contact": {"on": "bottom"},
    "friction": {"coefficient": 0.3, "smoothing": {"kernel": "convolution", "radius": 0.5}},
    "penalty": {"n": 100.0},
}


def _write(folder: Path, changes: dict[str, Any]) -> Path:
    data = copy.deepcopy(GOOD)
    for key, value in changes.items():
        *path, last = key.split(".")
        place: Any = data
        for name in path:
            place = place[int(name)] if name.isdigit() else place.setdefault(name, {})
        place[last] = value
    file = folder / "study.yml"
    with file.open("w") as stream:
        YAML(typ="safe").dump(data, stream)
    return file


def _refused(file: Path, output: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """Run the file, assert that it is refused cleanly, and return the message."""
    code = cli.main(["run", str(file), "--output", str(output)])
    captured = capsys.readouterr()
    assert code == 2, captured.err
    assert captured.err.startswith("error: ")
    assert "Traceback" not in captured.err
    return captured.err


STIFFNESS = [[2.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 1.0]]

CASES: dict[str, tuple[dict[str, Any], list[str]]] = {
    "unknown boundary name": (
        {"contact.on": "botom"},
        ["contact.on", "'botom'", "bottom", "left, right"],
    ),
    "unknown boundary of a load": (
        {"loads.tractions": [{"on": "up", "value": [0, 1]}]},
        ["loads.tractions.0.on", "'up'", "top"],
    ),
    "unknown region": (
        {"material.regions": {"core": {"locking_limit": 1.0}}},
        ["material.regions", "'core'", "body"],
    ),
    "no displacement condition": (
        {"loads.displacements": []},
        ["loads.displacements", "rigid motion", "translation along x"],
    ),
    "a roller that lets the body slide": (
        {"loads.displacements": [{"on": "left", "value": [None, 0.0]}]},
        ["loads.displacements", "rigid motion", "translation along x"],
    ),
    "contact and displacement on the same part": (
        {"loads.displacements": [{"on": ["left", "bottom"], "value": [0, 0]}]},
        ["loads.displacements", "bottom", "contact"],
    ),
    "negative locking limit": ({"material.locking_limit": -1}, ["material.locking_limit", "-1"]),
    "locking limit that reaches zero": (
        {"material.locking_limit": "x - 0.5"},
        ["material.locking_limit", "positive"],
    ),
    "n = 0": ({"penalty.n": 0}, ["penalty.n"]),
    "negative n": ({"penalty.n": -10}, ["penalty.n", "-10"]),
    "negative friction": ({"friction.coefficient": -0.1}, ["friction.coefficient", "-0.1"]),
    "friction that becomes negative": (
        {"friction.coefficient": "0.5 - x"},
        ["friction.coefficient", "negative"],
    ),
    "load of the wrong length": (
        {"loads.body_force": [0, 0, 1]},
        ["loads.body_force", "2"],
    ),
    "unknown name in an expression": (
        {"contact.gap": "0.1*radius"},
        ["contact.gap", "radius"],
    ),
    "function call that is not allowed": (
        {"loads.body_force": ["__import__('os').system('true')", 0]},
        ["loads.body_force.0"],
    ),
    "expression that is not finite": ({"contact.gap": "log(x - 2)"}, ["contact.gap", "log(x - 2)"]),
    "stiffness that is not symmetric": (
        {"material.elasticity": {"stiffness": [[2, 0.5, 0], [0.4, 2, 0], [0, 0, 1]]}},
        ["material.elasticity.stiffness", "symmetric"],
    ),
    "stiffness that is not elliptic": (
        {"material.elasticity": {"stiffness": [[2, 3, 0], [3, 2, 0], [0, 0, 1]]}},
        ["material.elasticity.stiffness", "eigenvalue", "-1"],
    ),
    "stiffness that is not elliptic somewhere": (
        {"material.elasticity": {"stiffness": [["2 - 4*x", *STIFFNESS[0][1:]], *STIFFNESS[1:]]}},
        ["material.elasticity", "eigenvalue"],
    ),
    "half space turned away": (
        {"contact.foundation": {"half_space": {"point": [0, 0], "normal": [0, -1]}}},
        ["contact.foundation", "normal"],
    ),
    "foundation out of this world": (
        {"contact.foundation": {"sphere": {"centre": [0, -1e308], "radius": 1e308}}},
        ["contact.foundation", "too far away or is too large"],
    ),
    "unknown key": ({"penalty.m": 3}, ["penalty.m", "n, epsilon"]),
    "unknown builder": ({"mesh": {"builder": "blok"}}, ["mesh.builder", "block"]),
    "missing mesh file": ({"mesh": {"file": "none.msh"}}, ["mesh.file", "none.msh"]),
}


@pytest.mark.parametrize("name", CASES)
def test_bad_data_are_refused_with_their_key(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes, expected = CASES[name]
    file = _write(tmp_path, changes)
    message = _refused(file, tmp_path / "out", capsys)
    assert f"{file}:" in message, "the message names the file and line"
    for text in expected:
        assert text in message
    assert not list((tmp_path / "out").glob("*")), "nothing is written"


def test_results_of_an_earlier_run_survive_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "out"
    output.mkdir()
    (output / "summary.json").write_text("precious")
    _refused(_write(tmp_path, {"contact.on": "botom"}), output, capsys)
    assert (output / "summary.json").read_text() == "precious"


def test_output_that_is_a_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("in the way")
    message = _refused(_write(tmp_path, {}), tmp_path / "out", capsys)
    assert "output.directory" in message
    assert (tmp_path / "out").read_text() == "in the way"


def test_radius_below_the_mesh_size_is_a_warning_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = _write(tmp_path, {"friction.smoothing.radius": 0.01})
    assert cli.main(["check", str(file), "--set", f"output.directory={tmp_path}/out"]) == 0
    assert "radius" in capsys.readouterr().err


def _mesh_file(path: Path, dim: int, *, names: bool = True, order: int = 1) -> None:
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        if dim == 1:
            a, b = (gmsh.model.geo.addPoint(x, 0.0, 0.0, 0.5) for x in (0.0, 1.0))
            gmsh.model.geo.addLine(a, b)
            gmsh.model.geo.synchronize()
            gmsh.model.addPhysicalGroup(1, [1], name="line")
        else:
            gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 1.0, 1.0)
            gmsh.model.occ.synchronize()
            if names:
                gmsh.model.addPhysicalGroup(2, [1], name="body")
                for tag, name in enumerate(("bottom", "right", "top", "left"), start=1):
                    gmsh.model.addPhysicalGroup(1, [tag], name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.3)
        gmsh.model.mesh.generate(dim)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


@pytest.mark.parametrize(
    ("dim", "options", "expected"),
    [
        (1, {}, "1D"),
        (2, {"names": False}, "physical group"),
        (2, {"order": 2}, "first-order"),
    ],
)
def test_meshes_that_will_not_do_are_refused(
    dim: int,
    options: dict[str, Any],
    expected: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    _mesh_file(tmp_path / "body.msh", dim, **options)
    file = _write(tmp_path, {"mesh": {"file": "body.msh"}})
    message = _refused(file, tmp_path / "out", capsys)
    assert "mesh.file" in message
    assert expected in message


def test_a_file_that_is_no_mesh_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "body.msh").write_text("$MeshFormat\nnonsense\n")
    file = _write(tmp_path, {"mesh": {"file": "body.msh"}})
    assert "mesh.file" in _refused(file, tmp_path / "out", capsys)


def test_a_mesh_of_the_users_own_with_named_groups_is_solved(tmp_path: Path) -> None:
    from contact_locking import problem, study_file

    _mesh_file(tmp_path / "body.msh", 2)
    study = study_file.load(_write(tmp_path, {"mesh": {"file": "body.msh"}}))
    solution = problem.solve(study.parameters, MPI.COMM_SELF)
    assert solution.converged
    assert set(solution.domain.facet_names) == {"bottom", "right", "top", "left"}
    assert solution.summary["contact_force"][1] > 0.0
