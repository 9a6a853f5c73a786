"""Fits from a study file and CSV files to fit.json, and what is refused on the way."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_folder import quick

from contact_locking import load
from contact_locking.arrays import FloatArray
from contact_locking.command import cli
from contact_locking.errors import InputError, NoDerivatives, NotConverged
from contact_locking.inverse.estimate import Residuals, Variable, estimate
from contact_locking.inverse.fitting import about_residuals, undetermined
from contact_locking.inverse.model import read_experiments

pytestmark = pytest.mark.serial

COLUMN = """
mesh: {builder: block, size: [1.0, 1.0], h: 0.5}
material: {elasticity: {young: 1.0, poisson: 0.0}}
loads: {displacements: [{on: top, value: [0, -0.01]}]}
contact: {on: bottom}
penalty: {n: .inf}
output: {directory: results, fields: false, picture: false}
"""
FIT = """
fit:
  data: curve.csv
  quantities: {force: contact_force.1}
  parameters: {material.elasticity.young: {start: 2.5, bounds: [0.1, 100]}}
"""
KEY = "loads.displacements.0.value.1"


class Folder:
    """A folder with a study file and its curves, in which commands run."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def write(self, study: str, **curves: str) -> None:
        (self.path / "study.yml").write_text(study)
        for name, text in curves.items():
            (self.path / f"{name}.csv").write_text(text)

    def fit(self, *words: str) -> int:
        output = ["--output", str(self.path / "results")]
        return cli.main(["fit", str(self.path / "study.yml"), "--quiet", *output, *words])

    @property
    def found(self) -> dict[str, Any]:
        content: dict[str, Any] = json.loads((self.path / "results/fit.json").read_text())
        return content

    @property
    def evaluations(self) -> dict[str, float]:
        """The files of evaluations, with the times of their last change."""
        files = (self.path / "results/evaluations").glob("*-*.json")
        every = {*files, *(self.path / "results/evaluations").glob("[0-9a-f]*.json")}
        return {path.name: path.stat().st_mtime for path in every if "files" not in path.name}


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path)


LINE = f"{KEY},force\n-0.01,0.0202\n-0.03,0.0599\n"


def test_a_modulus_is_fitted_to_a_line(folder: Folder) -> None:
    """A column without lateral strain: the force is E times the depth, here with E near 2."""
    folder.write(COLUMN + FIT, curve=LINE)
    assert folder.fit() == 0
    found, (depths, forces) = folder.found, ([0.01, 0.03], [0.0202, 0.0599])
    best = np.dot(depths, forces) / np.dot(depths, depths)
    entry = found["parameters"]["material.elasticity.young"]
    assert entry["value"] == pytest.approx(best, rel=1e-5)
    left = best * np.array(depths) - forces
    error = np.sqrt(left @ left / np.dot(depths, depths))
    assert entry["standard_error"] == pytest.approx(error, rel=1e-3)
    assert entry["interval"][0] < best < entry["interval"][1]
    assert found["correlation"] == [[pytest.approx(1.0)]] and found["undetermined"] == []
    assert found["curves"][0]["model"] == pytest.approx(best * np.array(depths), rel=1e-5)
    # The folder is that of a run at the numbers that were found, here in the last row.
    results = folder.path / "results"
    parameters = load(results / "parameters.yaml").parameters
    assert parameters.material.elasticity.young == pytest.approx(best, rel=1e-5)
    assert parameters.fit is None
    assert (results / "fit.png").read_bytes().startswith(b"\x89PNG")
    cli.main(["report", str(results)])
    assert "<h2>Fit</h2>" in (results / "report.html").read_text()


@quick
def test_a_fit_that_was_killed_goes_on(folder: Folder) -> None:
    folder.write(COLUMN + FIT, curve=LINE)
    study, results = str(folder.path / "study.yml"), folder.path / "results"
    command = [sys.executable, "-m", "contact_locking", "fit", study, "--output", str(results)]

    def kept() -> dict[Path, float]:
        found = results.glob("**/evaluations/[0-9a-f]*.json")
        return {path: path.stat().st_mtime for path in found if "files" not in path.name}

    process = subprocess.Popen(command)
    deadline = time.monotonic() + 120.0
    while not kept() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    before = kept()
    assert before and not (results / "fit.json").exists()
    assert folder.fit() == 0
    assert before.items() <= kept().items()


@quick
def test_several_experiments_share_their_numbers(folder: Folder) -> None:
    """The second column is half as high; its force is twice that of the same depth."""
    several = FIT.replace(
        "data: curve.csv",
        "data: [high.csv, {file: low.csv, set: {mesh.size: [1.0, 0.5], contact.gap: 0.001}}]",
    )
    low = f"{KEY},force,note\n-0.011,0.04,1\n"
    folder.write(COLUMN + several, high=f"{KEY},force\n-0.01,0.02\n", low=low)
    assert folder.fit() == 0
    entry = folder.found["parameters"]["material.elasticity.young"]
    assert entry["value"] == pytest.approx(2.0, rel=1e-4)
    assert [curve["file"] for curve in folder.found["curves"]] == ["high.csv", "low.csv"]
    assert (folder.path / "results/1-low/summary.json").exists()


STEPS = COLUMN.replace("[0, -0.01]", '[0, "-0.03*t"]') + "steps: {to: 1, count: 3}\n"


@quick
def test_times_between_the_steps_are_interpolated(folder: Folder) -> None:
    folder.write(STEPS + FIT, curve="t,force\n0,0\n0.2,0.012\n0.5,0.03\n1,0.06\n")
    assert folder.fit() == 0
    value = folder.found["parameters"]["material.elasticity.young"]["value"]
    assert value == pytest.approx(2.0, rel=1e-5)
    assert (folder.path / "results/history.csv").exists()


def test_one_datum_determines_one_number_without_a_standard_error(
    folder: Folder, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.write(COLUMN + FIT, curve="force\n0.02\n")
    assert folder.fit() == 0
    found = folder.found
    entry = found["parameters"]["material.elasticity.young"]
    assert entry["value"] == pytest.approx(2.0, rel=1e-5)
    assert entry["standard_error"] is None and found["undetermined"] == []
    assert len(found["words"]) == 1


@pytest.mark.parametrize(
    ("curve", "said"),
    [
        ("t,force\n", "has no rows of numbers"),
        ("", "has no column 'force'"),
        ("t,force\n1,nan\n", "curve.csv, row 2, force: 'nan' is no finite number"),
        ("t,force,sigma\n1,2,0\n", "sigma must be positive"),
        ("t,force\n0.5,2\n1000,3\n", "times from 0.5 to 1000, and the steps go from 0 to 1"),
        ("force\n2\n", "has no column t"),
    ],
)
def test_curves_that_cannot_be_used_are_refused(folder: Folder, curve: str, said: str) -> None:
    folder.write(STEPS + FIT, curve=curve)
    with pytest.raises(InputError, match=r"curve\.csv") as caught:
        read_experiments(load(folder.path / "study.yml").parameters)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("data: nothing.csv", "there is no such file"),
        ("parameters: {mesh.h: {start: 0.2}}", "mesh.h: the equations do not depend smoothly"),
        ("quantities: {force: locked_fraction}", "count of points"),
        ("parameters: {material.elasticity.young: {bounds: [2, 1]}}", "must ascend"),
        (
            "parameters: {material.elasticity.young: {start: 5, bounds: [1, 2]}}",
            "must be within the bounds, 1 to 2",
        ),
    ],
)
@quick
def test_a_fit_that_cannot_be_done_is_refused(
    folder: Folder, capfd: pytest.CaptureFixture[str], given: str, said: str
) -> None:
    key = given.partition(":")[0]
    lines = [
        f"  {given}" if line.strip().startswith(f"{key}:") else line for line in FIT.split("\n")
    ]
    folder.write(COLUMN + "\n".join(lines), curve=LINE)
    code = folder.fit()
    told = capfd.readouterr().err
    assert code == 2 and said in told and "study.yml" in told


T: FloatArray = np.linspace(0.1, 3.0, 40, dtype=float)
NOISE = 0.01


def variable(key: str, start: float, is_log: bool = False, least: float = 0.0) -> Variable:
    return Variable(key, start, least, np.inf, is_log)


def saturating(data: FloatArray) -> Callable[[FloatArray], Residuals | None]:
    """``a (1 - exp(-b t))``, without a solution for b > 4."""

    def misfit(numbers: FloatArray) -> Residuals | None:
        a, b = numbers
        if b > 4.0:
            return None
        decay = np.exp(-b * T)
        slopes = np.array([1.0 - decay, a * T * decay]).T
        return Residuals((a * (1.0 - decay) - data) / NOISE, slopes / NOISE)

    return misfit


def measured(seed: int) -> FloatArray:
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(T))
    return np.asarray(2.0 * (1.0 - np.exp(-1.5 * T)) + noise)


@pytest.mark.parametrize("is_log", [True, False])
def test_numbers_lie_within_their_errors(is_log: bool) -> None:
    inside = []
    for seed in range(40):
        variables = [variable("a", 1.0, is_log), variable("b", 3.9, is_log)]
        found = estimate(variables, saturating(measured(seed)), has_errors=True, derives=True)
        assert found.converged and not found.at_bound
        inside += list(np.abs(found.numbers - (2.0, 1.5)) <= 2.0 * found.errors)
    # 95 % of normal deviations are within two standard errors.
    assert 0.88 <= np.mean(inside) <= 1.0


def test_errors_and_intervals_are_those_of_a_line() -> None:
    """``p t``: the standard error is ``s/|t|``, and 95 % are Student's quantile of it."""
    data = 3.0 * T + NOISE * np.random.default_rng(1).standard_normal(len(T))

    def misfit(numbers: FloatArray) -> Residuals:
        return Residuals(numbers[0] * T - data, T[:, None])

    found = estimate([variable("p", 1.0)], misfit, has_errors=False, derives=True)
    best = data @ T / (T @ T)
    spread = np.sqrt(np.sum((best * T - data) ** 2) / 39.0 / (T @ T))
    assert found.numbers[0] == pytest.approx(best, rel=1e-6)
    assert found.errors[0] == pytest.approx(spread, rel=1e-6)
    assert found.intervals[0] == pytest.approx(best + np.array([-1, 1]) * 2.0227 * spread, rel=1e-5)


def test_a_product_is_known_where_its_factors_are_not() -> None:
    """``a b t`` is determined by ``a b``."""
    data = 3.0 * T + NOISE * np.random.default_rng(2).standard_normal(len(T))

    def misfit(numbers: FloatArray) -> Residuals:
        a, b = numbers
        return Residuals((a * b * T - data) / NOISE, np.array([b * T, a * T]).T / NOISE)

    found = estimate([variable("a", 1.0), variable("b", 2.0)], misfit, True, True)
    assert np.prod(found.numbers) == pytest.approx(3.0, rel=1e-2)
    assert np.all(np.isinf(found.errors))
    assert undetermined(found, ["a", "b"]) == ["a^0.71 b^-0.71: the data do not depend on it"]


@pytest.mark.parametrize("seed", range(10))
def test_a_number_beyond_a_kink_of_the_misfit_has_one_bound(seed: int) -> None:
    """Friction ``min(mu, 0.19)``: above 0.19 nothing slips, and 0.35 made the data."""

    def forces(numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
        young, mu = numbers
        slips = np.minimum(mu, 0.19 + 1e-4 * np.tanh(mu - 0.19))
        slope = np.where(mu < 0.19, 1.0, 1e-4 / np.cosh(mu - 0.19) ** 2)
        values = np.concatenate([young * T, slips * young * T])
        by_young = np.concatenate([T, slips * T])
        return values, np.array([by_young, np.concatenate([0.0 * T, slope * young * T])]).T

    noise = NOISE * np.random.default_rng(seed).standard_normal(2 * len(T))
    data = forces(np.array([1.3, 0.35]))[0] + noise

    def misfit(numbers: FloatArray) -> Residuals:
        values, slopes = forces(numbers)
        return Residuals(np.asarray((values - data) / NOISE), np.asarray(slopes / NOISE))

    variables = [Variable("E", 1.0, 0.05, 20.0, True), Variable("mu", 0.1, 0.01, 2.0, False)]
    found = estimate(variables, misfit, has_errors=True, derives=True)
    low, high = found.intervals[1]
    assert 0.18 < low < 0.2 and math.isinf(high) and math.isinf(found.errors[1])
    (told,) = undetermined(found, ["E", "mu"])
    assert told.startswith("mu: at least 0.1")


def test_no_solution_at_the_start_is_an_error() -> None:
    variables = [variable("a", 1.0), variable("b", 5.0)]
    with pytest.raises(NotConverged, match="give another start"):
        estimate(variables, saturating(measured(5)), has_errors=True, derives=True)


def test_a_wrong_model_is_seen_by_the_signs_of_its_residuals() -> None:
    noise = np.random.default_rng(6).standard_normal(60)
    bent = np.linspace(-1.0, 1.0, 60) ** 2 - 0.33
    (told,) = about_residuals("force", bent, 10.0 * np.ones(60), None, 1.0)
    assert "change their sign 2 times, noise would do so about 30" in told
    assert about_residuals("force", noise, 50.0 * np.ones(60), None, 1.0) == []
    # What is below the tolerance of the solver is no noise.
    assert about_residuals("force", 1e-6 * bent, np.ones(60), None, 1.0) == []


@quick
def test_differences_serve_where_derivatives_are_refused(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: Any) -> None:
        raise NoDerivatives("there are no derivatives")

    from contact_locking.inverse.sensitivities import Sensitivities

    monkeypatch.setattr(Sensitivities, "after", refused)
    folder.write(COLUMN + FIT, curve=LINE)
    assert folder.fit() == 0
    value = folder.found["parameters"]["material.elasticity.young"]["value"]
    assert value == pytest.approx(2.0, rel=5e-3)
    told = folder.found["words"][0]
    assert told == "there are no derivatives; without them each number takes one more solve"


def test_a_fit_without_a_solution_at_its_start_is_not_converged(folder: Folder) -> None:
    locked = COLUMN.replace("poisson: 0.0}", "poisson: 0.0}, locking_limit: 0.001")
    folder.write(locked.replace("bottom}", "bottom, gap: -0.1}") + FIT, curve=LINE)
    assert folder.fit() == 3 and not (folder.path / "results/fit.json").exists()
