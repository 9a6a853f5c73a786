"""Every demo runs on a coarse mesh: study files, on one and on two ranks, and scripts."""

from __future__ import annotations

import functools
import json
import math
import runpy
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from mpi4py import MPI
from slow import slow

from contact_locking import load
from contact_locking.command import cli

DEMOS = Path(__file__).parent.parent / "demos"
PLAIN = ("output.fields=false", "output.picture=false")
COARSE = {
    "block": ("mesh.h=0.08", *PLAIN),
    "block_3d": ("mesh.h=0.2", *PLAIN),
    "hertz": ("mesh.h=2", "mesh.h_contact=0.05", *PLAIN),
    "slip_friction": ("mesh.h=0.1", *PLAIN),
    "anisotropic_regions": ("mesh.h=0.1", *PLAIN),
    "stiffening": ("mesh.h=0.1", *PLAIN),
    "fabric": ("mesh.h=0.1", *PLAIN),
    "adaptive": ("mesh.h=0.25", "adapt.max_meshes=2", *PLAIN),
    "indentation": ("mesh.h=0.1", "steps.count=3", *PLAIN),
    "two_foundations": ("mesh.h=0.1", *PLAIN),
    "press_fit": ("mesh.h=0.12", *PLAIN),
    # Seven grains that fill a narrow box up to the piston.
    "grains": (
        *("mesh.width=4.02", "mesh.count=7", "mesh.seed=1"),
        "contact.1.foundation.polyline=[[4.02, 20], [4.02, 0], [0, 0], [0, 20]]",
        "contact.2.foundation.half_space.point=[0, 8.894]",
        *("steps.to=4", "steps.count=4"),
        *PLAIN,
    ),
    "soft_fingers": ("mesh.h=0.25", "mesh.h_contact=0.2", "steps.count=2", *PLAIN),
    "gripper": ("mesh.h=0.14", "steps.count=4", *PLAIN),
    "sensitivity": ("mesh.h=0.14", "steps.count=2", *PLAIN),
    "fit_indentation": ("mesh.h=10", *PLAIN),
    "ball_3d": ("mesh.h=0.5", "mesh.h_contact=0.06", *PLAIN),
    "pressed_tool": ("mesh.h=0.4", "steps.count=2", *PLAIN),
    "notch": ("mesh.h=0.2", "mesh.h_contact=0.05", *PLAIN),
    "ssnv128": ("mesh.h=2.5e-3", *PLAIN),
    "cyclic_slip": ("mesh.h=0.2", "mesh.h_contact=0.05", "steps.count=6", *PLAIN),
}
# Scripts without a study file: size and mesh.  They assert closed forms.
ALONE = {"impact": ("0.06", "16"), "viscous": ("0.15", "8"), "design": ("0.05", "16")}
ALONE |= {"stiffening_laws": ("0.08", "16"), "finite_strain": ("0.1", "6"), "wear": ("0.1", "40")}

# The demos with a finite n; the study files of the others are solved for n = .inf already.
PENALISED = ("block", "block_3d", "slip_friction", "anisotropic_regions", "stiffening")
# In the run of all tests under mpirun: linear solvers, contacts, bodies, processes and meshes.
ON_RANKS = ("block", "block_3d", "two_foundations", "press_fit", "pressed_tool", "adaptive")
ALWAYS_ON_TWO_RANKS = ("adaptive",)  # each of its meshes is a static problem
# A law of the user's own, several contacts, tools; building the documentation runs all scripts.
ALWAYS_AS_A_SCRIPT = ("block", "stiffening", "two_foundations", "pressed_tool")


def compliance(folder: Path, ranks: int) -> float:
    """The compliance in the summary of ``folder``, whose solve must have converged."""
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["converged"], summary["reason"]
    assert summary["ranks"] == ranks
    return float(summary["compliance"])


def run_file(name: str, folder: Path, *more: str) -> float:
    changes = [f"--set={change}" for change in (*COARSE[name], *more)]
    file = DEMOS / f"{name}.yml"
    assert cli.main(["run", str(file), "--quiet", *changes, f"--output={folder}"]) == 0
    return compliance(folder, MPI.COMM_WORLD.size)


@functools.cache
def of_file(name: str) -> float:
    """The compliance by the study file, which is solved once; collective."""
    # All ranks write to one folder.
    with tempfile.TemporaryDirectory() as folder:
        found = run_file(name, MPI.COMM_WORLD.bcast(Path(folder)))
        MPI.COMM_WORLD.Barrier()
    return found


@pytest.mark.serial
def test_every_demo_is_a_script_and_in_the_gallery_with_its_question() -> None:
    assert {path.stem for path in DEMOS.glob("*.yml")} == set(COARSE)
    assert {path.stem for path in DEMOS.glob("*.py")} == {*COARSE, *ALONE}
    given = {name: load(DEMOS / f"{name}.yml").parameters.penalty.n for name in COARSE}
    assert {name for name, n in given.items() if n < math.inf} == set(PENALISED)
    gallery = (DEMOS.parent / "docs" / "demos" / "index.md").read_text(encoding="utf-8")
    for name in (*COARSE, *ALONE):
        question = (DEMOS / f"{name}.py").read_text(encoding="utf-8").splitlines()[1][4:]
        assert question.endswith("?") and f"[{question}]({name}.ipynb)" in gallery
        assert f"]({name}.{'gif' if name == 'impact' else 'png'})" in gallery


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in ON_RANKS else pytest.mark.serial) for name in COARSE],
)
def test_study_file_converges(name: str) -> None:
    of_file(name)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("name", "n"),
    [
        # The method of the paper, which shows its contraction factor, is for n up to about 1e6.
        *(slow(name, "1e8") for name in COARSE if name != "slip_friction"),
        *((name, ".inf") for name in PENALISED if name != "slip_friction"),
    ],
)
def test_the_penalty_alone_may_be_changed_up_to_infinity(name: str, n: str, tmp_path: Path) -> None:
    run_file(name, MPI.COMM_WORLD.bcast(tmp_path), f"penalty.n={n}")


@pytest.mark.serial
@pytest.mark.parametrize("name", ALONE)
def test_script_alone_keeps_its_closed_forms_and_draws(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, *ALONE[name]])
    runpy.run_path(str(DEMOS / f"{name}.py"), run_name="__main__")
    assert (tmp_path / "results" / f"{name}.png").exists()
    assert (tmp_path / "results" / f"{name}.gif").exists() == (name == "impact")


@pytest.mark.serial
@pytest.mark.parametrize(
    "name", [name if name in ALWAYS_AS_A_SCRIPT else slow(name) for name in COARSE]
)
def test_script_gives_the_same_as_the_study_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script, target = str(DEMOS / f"{name}.py"), tmp_path / "script"
    monkeypatch.setattr(sys, "argv", [script, *COARSE[name], f"output.directory={target}"])
    runpy.run_path(script, run_name="__main__")
    assert compliance(target, 1) == pytest.approx(of_file(name), rel=1e-8)


@pytest.mark.serial
@pytest.mark.parametrize(
    "name", [name if name in ALWAYS_ON_TWO_RANKS else slow(name) for name in COARSE]
)
def test_script_gives_the_same_on_two_ranks(name: str, tmp_path: Path) -> None:
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        pytest.skip("mpirun is not installed")
    target, script = tmp_path / "two", str(DEMOS / f"{name}.py")
    words = ["-n", "2", sys.executable, script, *COARSE[name], f"output.directory={target}"]
    done = subprocess.run([mpirun, *words], capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stdout + done.stderr
    assert compliance(target, 2) == pytest.approx(of_file(name), rel=1e-8)
