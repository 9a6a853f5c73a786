"""Every mistake people make: one clear message with its place, exit code 2, nothing written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gmsh
import pytest
from changed_study import changed
from mpi4py import MPI

from contact_locking import study_file
from contact_locking.command import cli
from contact_locking.process import solving

pytestmark = pytest.mark.serial


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
        {"loads.displacements": [], "friction.coefficient": 0},
        ["loads.displacements", "rigid motion", "translation along x"],
    ),
    "a roller that lets the body slide": (
        {
            "loads.displacements": [{"on": "left", "value": [None, 0.0]}],
            "friction.coefficient": 0,
        },
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
    "no regularisation with Newton's method": (
        {"friction.regularisation": 0, "solver.method": "newton", "penalty.n": 1e3},
        ["friction.regularisation", "Newton's method", "interior_point"],
    ),
    "negative regularisation": ({"friction.regularisation": -1}, ["friction.regularisation"]),
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
    "gap in a list that is not finite": (
        {"contact": [{"on": "bottom", "gap": "log(x - 2)"}]},
        ["contact.0.gap", "log(x - 2)"],
    ),
    "coefficient of one part that becomes negative": (
        {"contact": [{"on": "bottom", "friction": {"coefficient": "0.3 - x"}}]},
        ["contact.0.friction.coefficient", "negative"],
    ),
    "part of a list that is not there": (
        {"contact": [{"on": "bottom"}, {"on": "wall"}]},
        ["contact.1.on", "wall", "left"],
    ),
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
        ["contact.foundation.sphere.radius", "too large", "at most 1e+100"],
    ),
    "traction that is no number somewhere": (
        {"loads.tractions": [{"on": "top", "value": [0, "sqrt(x - 0.5)"]}]},
        ["loads.tractions.0.value.1", "'sqrt(x - 0.5)' is nan at x = 0.0"],
    ),
    "traction with a pole where it is integrated": (
        {"mesh.h": 0.2, "loads.tractions": [{"on": "top", "value": [0, "1/(x - 0.5)"]}]},
        ["loads.tractions.0.value.1", "'1/(x - 0.5)' is", "at x = 0.5"],
    ),
    "body force that is no number somewhere": (
        {"loads.body_force": ["log(y - 0.5)", 0]},
        ["loads.body_force.0", "is nan at y = 0."],
    ),
    "traction that overflows": (
        {"loads.tractions": [{"on": "top", "value": [0, "exp(1000*x)"]}]},
        ["loads.tractions.0.value.1", "at x = 0.", "of at most 1e+100"],
    ),
    "load beyond all stiffness": (
        {"loads.tractions": [{"on": "top", "value": [0, -1e60]}]},
        ["loads.tractions.0.value", "times the stiffness", "units"],
    ),
    "n that underflows": ({"penalty.n": 1e-300}, ["penalty.n", "at least 1e-100"]),
    "epsilon that overflows": ({"penalty.epsilon": 1e300}, ["penalty.epsilon", "at most 1e+100"]),
    "stiffness that overflows": (
        {"material.elasticity.young": 1e300},
        ["material.elasticity.young", "at most 1e+100"],
    ),
    "stiffness that underflows": (
        {"material.elasticity": {"young": 1e-300, "poisson": 0.3}},
        ["material.elasticity", "eigenvalue", "at least 1e-100"],
    ),
    "locking limit that underflows": (
        {"material.locking_limit": "1e-200*x"},
        ["material.locking_limit", "at least 1e-100"],
    ),
    "gap that overflows": ({"contact.gap": -1e300}, ["contact.gap", "at most 1e+100"]),
    "radius that overflows": (
        {"friction.smoothing": {"kernel": "helmholtz", "radius": 1e300}},
        ["friction.smoothing.radius", "at most 1e+100"],
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
    file = changed(tmp_path, changes)
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
    _refused(changed(tmp_path, {"contact.on": "botom"}), output, capsys)
    assert (output / "summary.json").read_text() == "precious"


def test_output_that_is_a_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("in the way")
    message = _refused(changed(tmp_path, {}), tmp_path / "out", capsys)
    assert "output.directory" in message
    assert (tmp_path / "out").read_text() == "in the way"


def test_a_friction_coefficient_below_zero_is_refused_with_the_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = changed(tmp_path, {"friction.coefficient": "0.3 - 0.4*x"})
    message = _refused(file, tmp_path / "out", capsys)
    assert "must not be negative, it is -0.1 at x = 1, y = " in message


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
        (2, {"order": 3}, "first or second order"),
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
    file = changed(tmp_path, {"mesh": {"file": "body.msh"}})
    message = _refused(file, tmp_path / "out", capsys)
    assert "mesh.file" in message
    assert expected in message


def test_a_file_that_is_no_mesh_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "body.msh").write_text("$MeshFormat\nnonsense\n")
    file = changed(tmp_path, {"mesh": {"file": "body.msh"}})
    assert "mesh.file" in _refused(file, tmp_path / "out", capsys)


def test_a_mesh_of_the_users_own_with_named_groups_is_solved(tmp_path: Path) -> None:
    _mesh_file(tmp_path / "body.msh", 2)
    study = study_file.load(changed(tmp_path, {"mesh": {"file": "body.msh"}}))
    solution = solving.solve(study.parameters, MPI.COMM_SELF)
    assert solution.converged
    assert set(solution.domain.facet_names) == {"bottom", "right", "top", "left"}
    assert solution.summary["contact_force"][1] > 0.0
