"""The documentation says what is so: its links, keys, commands, study files and scripts."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dolfinx
import generated_reference
import pytest
from mpi4py import MPI

from contact_locking import from_mapping, solve, solve_steps
from contact_locking.command import cli
from contact_locking.mesh.sources import from_file
from contact_locking.results.solution import summary_text
from contact_locking.study_file.reading import read
from contact_locking.study_file.schema import rows

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted({*DOCS.glob("*.md"), *DOCS.glob("*/*.md"), ROOT / "README.md"})
NAMES = [str(path.relative_to(ROOT)) for path in PAGES]
# Pages that Sphinx makes from elsewhere.
MADE = {DOCS / "demos" / f"{path.stem}.ipynb" for path in (ROOT / "demos").glob("*.py")}


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def anchors(page: Path) -> set[str]:
    """The anchors of the headings, in the form of MyST and GitHub."""
    text = generated_reference.fill(page.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def commands(page: str) -> Iterator[list[str]]:
    """The words after contact-locking of every line of code that calls it."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for line in re.findall(r"^    (.*\bcontact-locking .*)$", text, re.MULTILINE):
        words = re.split(r"\s{3,}|\s+[#>]", line.partition("contact-locking ")[2])[0]
        # Some line of a shell is no call of ours: apt-get, cd, docker.
        if words.split()[0] in generated_reference.commands(cli.parser()):
            yield shlex.split(words)


@pytest.mark.parametrize("page", NAMES)
def test_links_between_pages_resolve(page: str) -> None:
    path = ROOT / page
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        if target.startswith(("http://", "https://")):
            continue
        name, _, anchor = target.partition("#")
        there = (path.parent / name).resolve() if name else path
        assert there.exists() or there in MADE, target
        if anchor:
            assert anchor in anchors(there), target


@pytest.mark.parametrize("page", NAMES)
def test_commands_have_options_that_exist(page: str) -> None:
    for words in commands(page):
        ours = words[: words.index("--")] if "--" in words else words
        cli.parser().parse_args(cli.one_setting_each(ours))
        for word in ours:
            assert not word.startswith("demos/") or (ROOT / word).exists(), word


@pytest.mark.parametrize("page", NAMES)
def test_study_files_in_the_pages_are_valid(page: str, tmp_path: Path) -> None:
    for block in blocks(page, "yaml"):
        file = tmp_path / "study.yml"
        file.write_text(block, encoding="utf-8")
        columns = ",".join(dict.fromkeys(re.findall(r"(?:over|column): (\w+)", block)))
        rows = "".join(f"\n{','.join([value] * (1 + columns.count(',')))}" for value in "01")
        for name in re.findall(r"\w+\.(?:msh|csv|npy)\b", block):
            (tmp_path / name).write_text(columns + rows, encoding="utf-8")
        from_mapping(read(file).data, tmp_path)


@pytest.mark.parametrize("page", NAMES)
def test_scripts_in_the_pages_are_python(page: str) -> None:
    for block in blocks(page, "python"):
        compile(block, page, "exec")


def test_every_key_of_the_schema_is_in_the_reference() -> None:
    page = generated_reference.fill((DOCS / "reference" / "study-file.md").read_text())
    for row in rows():
        assert f"`{row.key}`" in page or f"\n## {row.key}\n" in page, row.key
        assert row.description.replace("|", "\\|").lower() in page.lower(), row.key


def test_every_command_and_option_is_in_the_reference() -> None:
    page = generated_reference.fill((DOCS / "reference" / "command-line.md").read_text())
    for name, parser in generated_reference.commands(cli.parser()).items():
        assert f"## contact-locking {name}\n" in page
        for option in re.findall(r"--\w+", parser.format_help()):
            assert option in page


def test_the_summary_and_its_reference_have_the_same_keys() -> None:
    given = {
        "mesh": {"builder": "block", "h": 0.5},
        "material": {"locking_limit": 0.05},
        "loads": {
            "displacements": [{"on": "left", "value": [0, 0.001]}],
            "tractions": [{"on": "top", "value": [0, -0.05]}],
        },
        "friction": {"coefficient": 0.3, "smoothing": {"radius": 0.5}},
        "penalty": {"n": 1e4},
        "certificate": {"limit": True, "error_bound": True, "critical_friction": True},
        "sensitivities": {"of": "compliance", "to": "friction.coefficient"},
    }
    adapted = solve(from_mapping(given | {"adapt": {"max_meshes": 1}}))
    (step,) = solve_steps(from_mapping(given | {"steps": {"times": [1.0]}}))
    one = solve(from_mapping(given | {"equilibria": {"find": 1}, "branches": {"to": 0.1}}))
    several = {key: one.summary[key] for key in ("index", "equilibria", "branches")}
    found = adapted.with_entries(steps=step.summary["steps"], x=float("inf"), **several).summary
    summary = json.loads(summary_text(found))
    del summary["x"]
    page = generated_reference.fill((DOCS / "reference" / "summary.md").read_text())
    cells = re.findall(r"^\| (`.*?) \|", page, re.MULTILINE)
    described = {key for cell in cells for key in re.findall(r"`([^`]+)`", cell)}
    for key in described:
        assert _has(summary, key.split(".")), f"{key} is described and not there"
    for key in _leaves(summary):
        assert any(key == known or key.startswith(f"{known}.") for known in described), key


def _has(value: Any, steps: list[str]) -> bool:
    for step in steps:
        if not isinstance(value, dict) or step not in value:
            return False
        value = value[step]
    return True


def _leaves(value: Any, place: str = "") -> Iterator[str]:
    if not isinstance(value, dict):
        yield place
        return
    for key, item in value.items():
        # Said once for both places.
        if f"{place}{key}" != "certificate.bounds":
            yield from (name.removesuffix(".") for name in _leaves(item, f"{place}{key}."))


def test_the_guide_to_meshes_makes_a_mesh_that_is_solved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script, writer = blocks("docs/guides/mesh.md", "python")
    _, study = blocks("docs/guides/mesh.md", "yaml")
    monkeypatch.chdir(tmp_path)
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, timeout=60)
    Path("beam.yml").write_text(study, encoding="utf-8")
    plain = ("--set", "output.picture=false", "output.fields=false")
    assert cli.main(["run", "beam.yml", "--quiet", *plain]) == 0
    summary = json.loads(Path("results/beam/summary.json").read_text())
    assert 0.0 < summary["contact_area"] < 2.0
    beam = from_file(Path("beam.msh"), MPI.COMM_SELF)
    assert set(beam.cell_names) == {"body", "insert"} and "clamp" in beam.facet_names
    names: dict[str, Any] = {}
    exec(writer, names)
    beam.cell_tags.name, beam.facet_tags.name = "cells", "facets"
    names["write"]("own.xdmf", beam.mesh, [beam.cell_tags, beam.facet_tags])
    own = from_file(Path("own.xdmf"), MPI.COMM_SELF)
    assert sorted(own.cell_names) == ["1", "2"] and sorted(own.facet_names) == ["1", "2", "3"]


def script_of(number: int) -> str:
    """A script of the guide to Python, with what all after the second begin with."""
    scripts = blocks("docs/guides/script.md", "python")
    return scripts[number] if number < 2 else f"{scripts[1]}\n\n{scripts[number]}"


def test_the_guide_to_laws_caps_friction() -> None:
    names: dict[str, Any] = {}
    exec(script_of(4), names)
    points = names["solution"].contact_points
    strength = names["CappedBound"].strength
    if MPI.COMM_WORLD.rank == 0:
        assert points.bound.max() == pytest.approx(strength, rel=1e-12)
        assert points.bound.min() < strength


def test_the_guide_to_laws_states_constants_and_smooths_by_a_mean() -> None:
    names: dict[str, object] = {}
    exec(blocks("docs/guides/law.md", "python")[0], names)
    exec(blocks("docs/guides/law.md", "python")[1], names)


@pytest.mark.parametrize("number", range(len(blocks("docs/guides/script.md", "python"))))
def test_the_scripts_of_the_guide_to_python_are_short_and_run(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    script = script_of(number)
    assert len(script.splitlines()) <= 45
    if not dolfinx.__version__.startswith("0.9"):
        # As the guide says.
        script = script.replace("bcs=[hot]", 'bcs=[hot], petsc_options_prefix="heat_"')
    exec(script, {})


@pytest.mark.slow
def test_the_site_is_built_without_warnings(tmp_path: Path) -> None:
    """But for the demos' output, which tests/test_demos.py looks after."""
    if shutil.which("sphinx-build") is None:
        pytest.skip("Sphinx is not installed")
    options = ["-W", "--keep-going", "-q", "-b", "html", "-D", "nb_execution_mode=off"]
    log = subprocess.run(
        ["sphinx-build", *options, str(DOCS), str(tmp_path / "html")],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert log.returncode == 0, log.stderr
    assert "<math" in (tmp_path / "html" / "problem.html").read_text(encoding="utf-8")


def test_the_guide_to_press_fits_has_lames_pressure(tmp_path: Path) -> None:
    text = (DOCS / "guides" / "press-fit.md").read_text(encoding="utf-8")
    given = []
    for number, block in enumerate(blocks("docs/guides/press-fit.md", "yaml")):
        file = tmp_path / f"{number}.yml"
        file.write_text(block, encoding="utf-8")
        given.append(read(file).data)
    overlap, heat = given
    quadratic = overlap | {"discretisation": {"degree": 2}}
    found = [
        solve(from_mapping(data)).summary["contact_force"] for data in (overlap, quadratic, heat)
    ]
    pressures = [sum(map(abs, force)) / 2.0 for force in found]
    known = [opened / (5.0 / 3.0 + 0.3) for opened in (0.01, 0.0096)]
    assert f"= {known[0]:.5f}\n" in text and f"pressure is {known[1]:.5f}" in text
    assert f"The run has {pressures[0]:.5f}, and {pressures[1]:.5f} with" in text
    assert pressures[2] == pytest.approx(known[1], rel=6e-3)
