"""Imports run one way, from the command line to the laws."""

from __future__ import annotations

import ast
import functools
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import contact_locking

pytestmark = pytest.mark.serial

PACKAGE = Path(contact_locking.__file__).parent

# What the core does without: these register themselves, and the core never imports them.
WINGS = ("theory", "inverse", "view")
# A module imports only from its own package and from those above it in this list.
LAYERS = (
    ("errors", "findings", "arrays", "_version", "plain_text"),
    ("wings", "_compat", "parallel", "files"),
    ("expressions", "meshes"),
    ("values",),
    ("laws",),
    ("mesh",),
    ("shapes",),
    ("fem",),
    ("supports",),
    ("contact",),
    ("problem",),
    ("solver",),
    ("penalty_method",),
    ("results",),
    ("certificate",),
    ("process",),
    ("contact_problem",),
    ("study_file",),
    ("running",),
    ("theory", "view"),
    ("inverse",),
    ("command",),
    ("__main__",),
)
# Imports that are forbidden although the imported package stands above in the list.
FORBIDDEN = tuple(
    (core, "expressions")
    for core in ("supports", "contact", "problem", "solver", "certificate", "contact_problem")
)
MOST_AT_THE_ROOT = 12
# The most lines of each folder, which only shrink.
BUDGETS = {
    "": 1530,
    "certificate": 1730,
    "command": 930,
    "contact": 3550,
    "expressions": 640,
    "fem": 1240,
    "inverse": 3260,
    "laws": 830,
    "mesh": 2590,
    "meshes": 1510,
    "penalty_method": 680,
    "problem": 2990,
    "process": 1800,
    "results": 2450,
    "running": 1390,
    "shapes": 990,
    "solver": 6480,
    "study_file": 2080,
    "supports": 690,
    "theory": 3260,
    "values": 1020,
    "view": 2730,
}
# The lines that `contact_locking.ContactProblem` loads.
MOST_OF_A_PROBLEM = 13_550
# The core has its mesh builders beside it, in meshes/.
MOST_IN_THE_CORE, MOST_IN_WINGS, MOST_IN_TESTS = 33_550, 9_250, 31_860


def module(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


# In a checkout meshes/ is a link, which rglob does not follow.
FILES = {module(path): path for path in (*PACKAGE.rglob("*.py"), *PACKAGE.glob("meshes/*.py"))}


@functools.cache
def tree_of(name: str) -> ast.Module:
    """A module of the package, parsed."""
    return ast.parse(FILES[name].read_text(encoding="utf-8"))


def imported(name: str) -> Iterator[str]:
    """The names that a module imports, also inside functions and for type checkers."""
    package = name if FILES[name].name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(tree_of(name)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: package.count(".") + 2 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


@functools.cache
def graph() -> dict[str, set[str]]:
    """The modules of the package that each of its modules imports."""
    arrows: dict[str, set[str]] = {}
    for name in FILES:
        found = (word if word in FILES else word.rpartition(".")[0] for word in imported(name))
        arrows[name] = {word for word in found if word in FILES and word != name}
    return arrows


def test_no_imports_form_a_circle() -> None:
    # Raises CycleError, which names the modules of a circle.
    order = list(TopologicalSorter(graph()).static_order())
    assert len(order) == len(FILES) > 100


def test_packages_import_only_from_those_below_them() -> None:
    level = {name: number for number, names in enumerate(LAYERS) for name in names}

    def part(name: str) -> str:
        """The package or root module that a module belongs to; "" is the root itself."""
        return name.partition(".")[2].partition(".")[0]

    # The root offers names of all packages, lazily.
    pairs = {
        (part(name), part(other))
        for name, needs in graph().items()
        for other in needs
        if part(name) and part(other) not in ("", part(name))
    }
    upwards = {(a, b) for a, b in pairs if level[b] >= level[a]}
    assert not upwards and not pairs & set(FORBIDDEN)


def test_the_guide_for_contributors_lists_every_part_of_the_tree() -> None:
    guide = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    tree = guide.partition("    contact_locking/\n")[2].partition("\n\n")[0]
    rows = re.findall(r"^ {6}((?:\S+ )+) ", tree, re.MULTILINE)
    listed = [name.removesuffix("/").removesuffix(".py") for row in rows for name in row.split()]
    level = {name: number for number, names in enumerate(LAYERS) for name in names}
    assert {*listed, "__main__"} == {*level}
    assert sorted(listed, key=lambda name: level[name]) == listed


def test_no_module_is_named_for_odds_and_ends() -> None:
    names = {path.stem for path in FILES.values()}
    assert not {"utils", "helpers", "util", "helper", "misc", "common"} & names
    assert len(list(PACKAGE.glob("*.py"))) <= MOST_AT_THE_ROOT


def lines_of(folder: Path) -> int:
    # In a checkout meshes/ is a link, which rglob does not follow.
    files = {*folder.rglob("*.py"), *folder.glob("meshes/*.py"), *folder.glob("*.py")}
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)


def test_a_shape_is_known_by_its_class_alone() -> None:
    """No module beside its own names it, so that a further shape is one class in one file."""
    shapes = {
        node.name
        for node in ast.walk(tree_of("contact_locking.shapes.analytic"))
        if isinstance(node, ast.ClassDef) and not node.name.startswith("LevelSet")
    }
    assert {"HalfSpace", "Sphere", "Cylinder"} == shapes
    others = [name for name in FILES if name.startswith("contact_locking.")]
    found = {
        (name, node.id)
        for name in others
        if name != "contact_locking.shapes.analytic"
        for node in ast.walk(tree_of(name))
        if isinstance(node, ast.Name) and node.id in shapes
    }
    assert found == set()


def test_no_folder_grows_beyond_its_budget() -> None:
    lines = {path.name: lines_of(path) for path in PACKAGE.iterdir() if path.is_dir()}
    lines = {name: count for name, count in lines.items() if count}
    root = sum(len(path.read_text().splitlines()) for path in PACKAGE.glob("*.py"))
    assert {**lines, "": root}.keys() == BUDGETS.keys()
    above = {name: count for name, count in lines.items() if count > BUDGETS[name]}
    assert not above and root <= BUDGETS[""]
    in_wings = sum(lines[name] for name in WINGS)
    assert in_wings <= MOST_IN_WINGS
    assert sum(lines.values()) + root - in_wings - lines["meshes"] <= MOST_IN_THE_CORE
    assert lines_of(Path(__file__).parent) <= MOST_IN_TESTS


def test_docstrings_refer_to_modules_that_exist() -> None:
    short = {name.rpartition(".")[2] for name in FILES}
    referred = {
        word
        for path in FILES.values()
        for word in re.findall(r":mod:`~?([^`]+)`", path.read_text(encoding="utf-8"))
    }
    assert len(referred) > 5
    assert {word for word in referred if word not in FILES and word not in short} == set()


def test_local_names_are_nouns_that_say_what_they_hold() -> None:
    vague = {"found", "given", "told", "wanted", "one", "item", "own", "here", "there", "more"}
    names = {
        (name, node.arg if isinstance(node, ast.arg) else node.id)
        for name in FILES
        for node in ast.walk(tree_of(name))
        if isinstance(node, ast.arg) or isinstance(getattr(node, "ctx", None), ast.Store)
        if isinstance(node, ast.arg | ast.Name)
    }
    assert not [(name, word) for name, word in names if word in vague]


def written(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """The objects and attributes that a piece of code assigns to, also to an element of one."""
    for node in ast.walk(tree):
        is_stored = isinstance(getattr(node, "ctx", None), ast.Store | ast.Del)
        while isinstance(node, ast.Subscript):
            node = node.value
        if is_stored and isinstance(node, ast.Attribute):
            yield ast.unparse(node.value), node.attr


def test_no_module_but_those_of_contacts_writes_to_a_contact_or_its_friction() -> None:
    """By name: nothing of the name of an attribute or a property of these is assigned to."""
    names: set[str] = set()
    for module in (
        "contact_locking.contact.nodal_contact",
        "contact_locking.contact.coulomb",
    ):
        names |= {name for owner, name in written(tree_of(module)) if owner == "self"}
        names |= {n.name for n in ast.walk(tree_of(module)) if isinstance(n, ast.FunctionDef)}
    assert {"friction", "gaps", "state", "travel", "regularisation", "smoothing"} <= names
    assert not [
        f"{module}: {owner}.{name}"
        for module in FILES
        if not module.startswith("contact_locking.contact.")
        for owner, name in written(tree_of(module))
        if name in names and owner != "self"
    ]


def test_no_module_writes_into_the_summary_of_a_solution() -> None:
    """`Solution.with_entries` returns the solution with further entries."""
    changing = re.compile(
        r"\.summary(\[[^]]*\])*\.(append|extend|insert|pop|setdefault|update|clear)\("
    )
    assert changing.search('last.summary["warnings"].append(text)')
    assert [*written(ast.parse('last.summary["steps"]["time"] += 1'))] == [("last", "summary")]
    assert not [
        module
        for module, path in FILES.items()
        if changing.search(path.read_text(encoding="utf-8"))
        or any(name == "summary" for _, name in written(tree_of(module)))
    ]


def test_nothing_imports_the_command_line_and_the_core_no_wing() -> None:
    command, wings = "contact_locking.command", tuple(f"contact_locking.{name}" for name in WINGS)
    for name, needed in graph().items():
        part = name.partition(".")[2].partition(".")[0]
        if part not in ("command", "__main__"):
            assert not any(word.startswith(command) for word in needed), name
        if part not in (*WINGS, "command", ""):
            assert not any(word.startswith(wings) for word in needed), name


def test_without_the_wings_a_study_runs_and_says_nothing_of_them(tmp_path: Path) -> None:
    kept = shutil.ignore_patterns(*WINGS, "__pycache__")
    # Files of demos are links.
    shutil.copytree(PACKAGE, tmp_path / "contact_locking", ignore=kept)
    words = ["run", str(PACKAGE.parent / "demos" / "block.yml"), "--set", "mesh.h=0.25"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-m", "contact_locking", *words],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    results = tmp_path / "results" / "block"
    summary = json.loads((results / "summary.json").read_text())
    assert summary["converged"] and not {"bounds", "constants"} & set(summary["certificate"])
    assert not (results / "picture.png").exists()
    assert not re.search("proved|unique|wing|picture", done.stdout + done.stderr)
    refused = subprocess.run(
        [sys.executable, "-m", "contact_locking", *words, "certificate.constants=true"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert refused.returncode == 2 and "certificate.constants" in refused.stderr


def test_study_files_and_reports_are_read_without_dolfinx() -> None:
    names = ("command.cli", "study_file", "running.runner", "view.report.pages")
    script = "import importlib, sys\n"
    script += "".join(f"importlib.import_module('contact_locking.{name}')\n" for name in names)
    script += "print({'dolfinx', 'mpi4py', 'petsc4py', 'ufl', 'gmsh'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("set()\n", "")


def test_a_contact_problem_loads_what_states_it_and_no_solver() -> None:
    script = """
import sys
from pathlib import Path
import contact_locking
contact_locking.ContactProblem
files = [module.__file__ for name, module in sys.modules.items() if name.startswith("contact_lo")]
print(sum(len(Path(file).read_text().splitlines()) for file in files if file))
needless = "certificate.verdict mesh.readers meshes process running solver.strategy study_file"
print({f"contact_locking.{name}" for name in needless.split()} & set(sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    lines, needless = done.stdout.splitlines()
    assert int(lines) <= MOST_OF_A_PROBLEM and needless == "set()", done.stderr


def test_check_imports_neither_solvers_nor_results_nor_pictures() -> None:
    """They would take a third of the time of the command."""
    script = """
import contextlib, io, sys
from contact_locking.command import cli
with contextlib.redirect_stdout(io.StringIO()):
    code = cli.main(["check", "demos/block.yml"])
heavy = ("solver.strategy", "certificate.verdict", "running.solving", "running.run", "view.report")
loaded = {f"contact_locking.{name}" for name in heavy} & set(sys.modules)
print(code, loaded | {"matplotlib", "scipy", "pyvista", "jinja2"} & set(sys.modules))
"""
    root = PACKAGE.parent
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=root, check=True
    )
    assert done.stdout == "0 set()\n"
