"""Distances between solutions, fitted rates, and what the studies of demos/studies find."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from convergence import distance, fitted_rate, norms
from dolfinx import fem
from mpi4py import MPI
from problems import block
from rates import rate_plot
from transfer import on_mesh_of

from contact_locking import study_file
from contact_locking.mesh import sources
from contact_locking.mesh.domain import Domain
from contact_locking.meshes.block import Block
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving

STUDIES = Path(__file__).parents[2] / "demos" / "studies"
MEASURED = "penalty_measured"


def grid(divisions: int, dim: int = 2, edge: float = 1.0) -> Domain:
    shape = Block(dim=dim, size=(edge,) * dim, h=edge / divisions, structured=True)
    return sources.from_geometry(shape, MPI.COMM_WORLD)


def field(domain: Domain, power: int) -> fem.Function:
    """``((x + y)^power, 0, ...)``."""
    u = fem.Function(fem.functionspace(domain.mesh, ("P", 1, (domain.dim,))))

    def value(x: Any) -> Any:
        found = 0.0 * x[: domain.dim]
        found[0] = (x[0] + x[1]) ** power
        return found

    u.interpolate(value)
    u.x.scatter_forward()
    return u


def solved(divisions: int, comm: MPI.Intracomm = MPI.COMM_WORLD, **changes: Any) -> StudySolution:
    given = {"penalty__n": math.inf, "mesh__structured": True, **changes}
    solution = solving.solve(block(2, 1.0 / divisions, **given), comm)
    assert solution.converged, solution.summary["reason"]
    return solution


@pytest.mark.serial
def test_the_rate_of_a_power_is_its_exponent() -> None:
    assert fitted_rate([1.0, 0.1, 0.01], [3.0, 0.03, 0.0003]) == pytest.approx(2.0, rel=1e-12)


@pytest.mark.serial
def test_norms_of_a_known_field_are_exact() -> None:
    domain = grid(4)
    found = norms(field(domain, 1), domain, ("bottom",))
    exact = math.sqrt(1.5), math.sqrt(7.0 / 6.0), math.sqrt(1.0 / 3.0)
    assert (found.v, found.l2, found.contact) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_coarse_field_is_the_same_on_a_nested_grid(dim: int) -> None:
    coarse, fine = grid(2, dim), grid(6, dim)
    u = field(coarse, 2)
    there = norms(on_mesh_of(u, field(fine, 1)), fine, ("bottom",))
    here = norms(u, coarse, ("bottom",))
    assert (there.v, there.l2) == pytest.approx((here.v, here.l2), rel=1e-12)
    assert there.contact == pytest.approx(here.contact, rel=1e-12)


@pytest.mark.serial
def test_the_distance_on_one_mesh_is_that_of_the_certificate() -> None:
    soft = solved(8, penalty__n=1e2, certificate__limit=True)
    measured = soft.summary["certificate"]["errors"][MEASURED]["displacement_norm"]
    assert distance(soft, solved(8)).v == pytest.approx(measured, rel=1e-6)


def measured_rate(key: str, values: list[float], **changes: Any) -> float:
    """The rate of the distance to the solution of the inequality on the same mesh."""
    given = {"certificate__limit": True, **changes}
    runs = [solved(8, **{**given, f"penalty__{key}": value}) for value in values]
    errors = [run.summary["certificate"]["errors"][MEASURED] for run in runs]
    return fitted_rate(values, [error["displacement_norm"] for error in errors])


@pytest.mark.serial
def test_theorem_4_9_the_locking_penalty_alone_has_rate_one_on_one_mesh() -> None:
    rate = measured_rate("n", [1e3, 1e4, 1e5], penalty__epsilon=1e-12)
    assert rate == pytest.approx(-1.0, abs=0.1)


@pytest.mark.serial
def test_theorem_4_10_the_inequality_converges_with_the_mesh_alone() -> None:
    reference = solved(96)
    divisions = [6, 12, 24]
    errors = [distance(solved(d), reference) for d in divisions]
    sizes = [1.0 / d for d in divisions]
    assert fitted_rate(sizes, [error.v for error in errors]) == pytest.approx(0.9, abs=0.2)


@pytest.mark.serial
@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.yml")), ids=lambda path: path.stem)
def test_every_study_can_be_run(path: Path) -> None:
    study = study_file.load(path, []).parameters.study
    assert study is not None
    assert len(list(study.cases())) >= 6


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, STUDIES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.serial
@pytest.mark.parametrize(
    ("name", "words", "smaller"),
    [
        pytest.param(
            "theorem_4_10",
            ["--finest", "16"],
            {"DIVISIONS": (2, 4, 8), "EXPONENTS": (1.0, 2.0)},
            marks=pytest.mark.slow,
        ),
        ("local_friction", ["--divisions", "10"], {"RADII": (0.4, 0.2)}),
        ("locking_stress", ["--finest", "16"], {"COARSEST": 4}),
    ],
)
def test_script_writes_a_table_that_can_be_drawn(
    name: str,
    words: list[str],
    smaller: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    study, figures = script(name), script("figures")
    for key, value in {"RESULTS": tmp_path / name, **smaller}.items():
        monkeypatch.setattr(study, key, value)
    monkeypatch.setattr(sys, "argv", [name, *words])
    study.main()
    monkeypatch.setattr(figures, "RESULTS", tmp_path)
    panels = figures.FIGURES[name]()
    rates = [curve.rate for panel in panels for curve in panel.curves if curve.fitted]
    assert rates and all(math.isfinite(rate) for rate in rates)
    rate_plot(panels, tmp_path / "figure.svg")
    assert (tmp_path / "figure.svg").stat().st_size > 10_000
