"""A mesh with fewer cells than ranks has the results of one rank, and nothing waits for ever."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from contact_locking.command import cli

pytestmark = pytest.mark.serial

LAUNCHER = shutil.which("mpirun")
RANKS = 3
LOADS = {
    "tractions": [{"on": "top", "value": [0.03, -0.05]}],
    "displacements": [{"on": "left", "value": [0, 0]}],
}
#: Two triangles, or six tetrahedra.
SQUARE = {"builder": "block", "h": 1.0, "structured": True}
CUBE = {**SQUARE, "dim": 3, "size": [1, 1, 1]}
BLOCK: dict[str, Any] = {
    "mesh": SQUARE,
    "material": {"locking_limit": 0.05},
    "loads": LOADS,
    "contact": {"on": "bottom"},
    "friction": {"coefficient": 0.3, "smoothing": {"radius": 1.5}},
    "output": {"probes": [{"points": [[0.3, 0.4]]}]},
}
STUDIES: dict[str, dict[str, Any]] = {
    "a block": BLOCK | {"certificate": {"constants": True, "error_bound": True}},
    "quadratic elements": BLOCK | {"discretisation": {"degree": 2}},
    "a penalty and multigrid": BLOCK | {"penalty": {"n": 1e3}, "solver": {"linear": "iterative"}},
    "a process": BLOCK
    | {
        "loads": LOADS | {"tractions": [{"on": "top", "value": ["0.03*t", "-0.05*t"]}]},
        "steps": {"to": 1.0, "count": 2},
    },
    "adapted meshes": BLOCK | {"adapt": {"tolerance": 0.3, "max_dofs": 100}},
    "a body of revolution": BLOCK
    | {
        "mesh": SQUARE | {"axisymmetric": True},
        "loads": {
            "tractions": [{"on": "top", "value": [0, -0.05]}],
            "supports": [{"on": "left", "along": "normal"}],
        },
    },
    "a tool that a force pushes": {
        "mesh": CUBE,
        "material": {"locking_limit": 0.05},
        "loads": {
            "tractions": [{"on": "right", "value": [-0.01, 0.003, 0]}],
            "displacements": [{"on": "bottom", "value": [0, 0, 0]}],
        },
        "contact": {
            "on": "top",
            "foundation": {
                "sphere": {"centre": [0.5, 0.5, 11.0], "radius": 10.0},
                "force": [0, 0, -0.01],
            },
        },
        "friction": {"coefficient": 0.3, "smoothing": {"radius": 1.5}},
        "output": {"picture": False},
    },
}

# These go through what every run does, and through the most that a certificate computes.
QUICK = ("a tool that a force pushes",)


def on_ranks(*words: str) -> subprocess.CompletedProcess[str]:
    """A command on more ranks than the mesh has cells for."""
    assert LAUNCHER is not None
    program = [sys.executable, "-m", "contact_locking", *words]
    return subprocess.run(
        [LAUNCHER, "-n", str(RANKS), "--oversubscribe", *program],
        capture_output=True,
        text=True,
        timeout=100,
        env={**os.environ, "OMPI_MCA_mpi_yield_when_idle": "1"},
    )


def numbers(folder: Path) -> dict[str, Any]:
    """What does not depend on the ranks, in one table."""
    summary = json.loads((folder / "summary.json").read_text())
    keys = ("contact_force", "friction_force", "strain_norm_max", "penetration_max")
    return {key: summary[key] for key in keys}


@pytest.mark.skipif(LAUNCHER is None, reason="there is no mpirun")
@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in STUDIES],
)
def test_more_ranks_than_cells_have_the_results_of_one(name: str, tmp_path: Path) -> None:
    file, one, several = tmp_path / "study.yml", tmp_path / "one", tmp_path / "several"
    file.write_text(yaml.safe_dump(STUDIES[name]))
    assert cli.main(["run", str(file), "--quiet", "--output", str(one)]) == 0
    done = on_ranks("run", str(file), "--quiet", "--output", str(several))
    assert done.returncode == 0, done.stderr
    expected = numbers(one)
    for key, value in numbers(several).items():
        assert value == pytest.approx(expected[key], rel=1e-6, abs=1e-8), key
    assert {path.name for path in several.iterdir()} == {path.name for path in one.iterdir()}
