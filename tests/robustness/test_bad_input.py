"""Every mistake people make: one clear message with its place, exit code 2, nothing written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from changed_study import changed

from contact_locking.command import cli

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

CASES: list[tuple[dict[str, Any], str]] = [
    ({"loads.tractions": [{"on": "up", "value": [0, 1]}]}, "loads.tractions.0.on"),
    ({"material.regions": {"core": {"locking_limit": 1.0}}}, "material.regions"),
    ({"loads.displacements": [], "friction.coefficient": 0}, "loads.displacements"),
    ({"loads.displacements": [{"on": ["left", "bottom"], "value": [0, 0]}]}, "loads.displacements"),
    ({"material.locking_limit": "x - 0.5"}, "material.locking_limit"),
    ({"friction.coefficient": "0.5 - x"}, " friction.coefficient: "),
    ({"loads.body_force": ["__import__('os').system('true')", 0]}, "loads.body_force.0"),
    ({"contact.gap": "log(x - 2)"}, "contact.gap"),
    ({"contact": [{"on": "bottom", "gap": "log(x - 2)"}]}, "contact.0.gap"),
    (
        {"contact": [{"on": "bottom", "friction": {"coefficient": "0.3 - x"}}]},
        "contact.0.friction.coefficient",
    ),
    ({"contact": [{"on": "bottom"}, {"on": "wall"}]}, "contact.1.on"),
    (
        {"material.elasticity": {"stiffness": [["2 - 4*x", *STIFFNESS[0][1:]], *STIFFNESS[1:]]}},
        "material.elasticity",
    ),
    (
        {"contact.foundation": {"half_space": {"point": [0, 0], "normal": [0, -1]}}},
        "contact.foundation",
    ),
    (
        {"contact.foundation": {"sphere": {"centre": [0, -1e308], "radius": 1e308}}},
        "contact.foundation.sphere.radius",
    ),
    (
        {"loads.tractions": [{"on": "top", "value": [0, "sqrt(x - 0.5)"]}]},
        "loads.tractions.0.value.1",
    ),
    (
        {"mesh.h": 0.2, "loads.tractions": [{"on": "top", "value": [0, "1/(x - 0.5)"]}]},
        "loads.tractions.0.value.1",
    ),
    ({"loads.body_force": ["log(y - 0.5)", 0]}, "loads.body_force.0"),
    (
        {"loads.tractions": [{"on": "top", "value": [0, "exp(1000*x)"]}]},
        "loads.tractions.0.value.1",
    ),
    ({"material.elasticity": {"young": 1e-300, "poisson": 0.3}}, "material.elasticity"),
    ({"material.locking_limit": "1e-200*x"}, "material.locking_limit"),
]


@pytest.mark.parametrize(("changes", "key"), CASES)
def test_bad_data_are_refused_with_their_key(
    changes: dict[str, Any], key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = changed(tmp_path, changes)
    message = _refused(file, tmp_path / "out", capsys)
    assert f"{file}:" in message and key in message, "the message names the file, line and key"
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
