"""Imports run one way, from the command line down to the laws, and modules are short."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "contact_locking"

# A module imports only from its own package and from those above it in this list.
LAYERS = (
    ("errors", "arrays", "_version", "plain_text", "monitor"),
    ("_compat", "parallel"),
    ("laws", "expressions", "meshes"),
    ("parameters", "mesh_file"),
    ("study_file", "problem"),
    ("solver",),
    ("results",),
    ("certificate", "convergence"),
    ("checkpoint", "plotting"),
    ("report", "solving"),
    ("writing", "studies"),
    ("command",),
    ("__main__",),
)
# What a package must not know although it stands above.
FORBIDDEN = (
    ("laws", "parameters"),
    ("laws", "problem"),
    ("solver", "parameters"),
    ("solver", "study_file"),
    ("solver", "expressions"),
    ("study_file", "problem"),
)
MOST_LINES, MOST_AT_THE_ROOT = 300, 12


def modules() -> dict[str, Path]:
    names = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        names[".".join(parts).removesuffix(".__init__")] = path
    return names


def imports(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """The modules of the package that a module imports anywhere, lazily or for types alone, too."""
    home = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = home.split(".")[: len(home.split(".")) - node.level + 1]
                base = ".".join([*above, *filter(None, [node.module])])
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                found.add(inner if inner in known else base)
    return {other for other in found if other in known and other != name}


def graph() -> dict[str, set[str]]:
    known = modules()
    return {name: imports(name, path, known) for name, path in known.items()}


def part(name: str) -> str:
    """The package or root module that a module belongs to; "" is the root itself."""
    return name.partition(".")[2].partition(".")[0]


@pytest.mark.serial
def test_imports_have_no_circle() -> None:
    left = graph()
    while free := [name for name, needs in left.items() if not needs & left.keys()]:
        for name in free:
            del left[name]
    assert not left, f"in or above a circle of imports: {sorted(left)}"


@pytest.mark.serial
def test_packages_import_only_from_those_that_stand_below_them() -> None:
    level = {name: number for number, names in enumerate(LAYERS) for name in names}
    # The root offers names of all packages, lazily.
    pairs = {
        (part(name), part(other))
        for name, needs in graph().items()
        for other in needs
        if part(name) and part(other) != part(name)
    }
    upwards = {(a, b) for a, b in pairs if b not in level or level[b] >= level[a]}
    assert not upwards and not pairs & set(FORBIDDEN)


@pytest.mark.serial
def test_modules_are_short_and_named_apart() -> None:
    paths = modules().values()
    counts = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in paths}
    assert {path.name: n for path, n in counts.items() if n > MOST_LINES} == {}
    # Mesh builders are found by their names, which may be those of anything.
    named = Counter(path.stem for path in paths if path.parent.name != "meshes")
    assert [name for name, n in named.items() if n > 1 and name != "__init__"] == []
    assert not {"utils", "helpers", "util", "helper", "misc", "common"} & named.keys()
    assert len(list(PACKAGE.glob("*.py"))) <= MOST_AT_THE_ROOT


@pytest.mark.serial
def test_a_study_file_is_read_and_checked_without_dolfinx_or_mpi() -> None:
    code = (
        "import sys; from contact_locking import from_mapping; from_mapping({}); "
        "print([name for name in sys.modules if name.partition('.')[0] in "
        "('dolfinx', 'ufl', 'mpi4py', 'petsc4py', 'gmsh')])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert found.stdout.strip() == "[]"
