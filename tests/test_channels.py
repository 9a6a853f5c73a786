"""What the channels say about the program agrees: citation, archive, recipe, paper, package."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from contact_locking import __version__

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[1]


def from_yaml(name: str) -> Any:
    return YAML(typ="safe").load(ROOT / name)


CITATION = from_yaml("CITATION.cff")
ARCHIVE = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
RECIPE = from_yaml("recipe/recipe.yaml")


def test_the_version_is_the_same_everywhere() -> None:
    versions = (CITATION["version"], ARCHIVE["version"], RECIPE["context"]["version"])
    assert versions == (__version__,) * 3


def test_the_archive_agrees_with_the_citation() -> None:
    assert ARCHIVE["title"] == CITATION["title"]
    assert ARCHIVE["license"] == CITATION["license"] == RECIPE["about"]["license"]
    assert ARCHIVE["keywords"] == CITATION["keywords"]
    assert ARCHIVE["description"] == CITATION["abstract"]
    authors = [author["name"] for author in CITATION["authors"]]
    assert [creator["name"] for creator in ARCHIVE["creators"]] == authors
    (paper,) = CITATION["references"]
    assert (
        paper["title"] in ARCHIVE["references"][0]
        and str(paper["year"]) in ARCHIVE["references"][0]
    )


def test_the_recipe_has_the_dependencies_of_the_package() -> None:
    wanted = {re.split(r"[^\w.-]", name)[0] for name in PROJECT["dependencies"]}
    listed = {line.split()[0] for line in RECIPE["requirements"]["run"]}
    # Matplotlib without a window is enough.
    assert wanted - {"matplotlib"} <= listed and "matplotlib-base" in listed
    assert {"fenics-dolfinx", "petsc4py", "python-gmsh"} <= listed
    (entry,) = RECIPE["build"]["python"]["entry_points"]
    name, _, target = entry.partition(" = ")
    assert PROJECT["scripts"] == {name: target}


def test_the_paper_has_what_the_journal_asks_for() -> None:
    _, head, text = (ROOT / "paper.md").read_text(encoding="utf-8").split("---\n", 2)
    about = YAML(typ="safe").load(head)
    assert [author["name"] for author in about["authors"]] == [
        a["name"] for a in CITATION["authors"]
    ]
    assert {"title", "tags", "affiliations", "date", "bibliography"} <= set(about)
    assert re.findall(r"^# (.*)$", text, re.MULTILINE) == [
        "Summary",
        "Statement of need",
        "State of the field",
        "Software design",
        "Research impact statement",
        "AI usage disclosure",
        "References",
    ]
    assert 750 <= len(text.split()) <= 1750
    known = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "paper.bib").read_text("utf-8"), re.MULTILINE))
    assert set(re.findall(r"@(\w+\d{4})", text)) == known


@pytest.mark.parametrize(
    "file", sorted((ROOT / ".github").rglob("*.yml")), ids=lambda path: path.name
)
def test_workflows_and_forms_are_yaml_and_call_targets_that_exist(file: Path) -> None:
    data = YAML(typ="safe").load(file)
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for job in data.get("jobs", {}).values():
        for step in job["steps"]:
            for command in step.get("run", "").splitlines():
                words = command.split()
                if words[:1] == ["make"]:
                    assert words[1] in targets
                if words and words[0].startswith("."):
                    assert (ROOT / words[0]).is_file()


def test_the_image_gets_every_file_that_the_package_links_to() -> None:
    """Docker leaves out what .dockerignore does not name, and links to it would lead nowhere."""
    taken = (ROOT / ".dockerignore").read_text().splitlines()
    links = [path for path in (ROOT / "contact_locking").rglob("*") if path.is_symlink()]
    assert links
    for link in links:
        target = link.resolve().relative_to(ROOT)
        folder = str(target.parent)
        assert {f"!{target}", f"!{folder}/*{target.suffix}"} & set(taken), target
