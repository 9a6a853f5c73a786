"""Messages of the core in a script have the names of its arguments, not those of a study file."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import contact_locking
from contact_locking.errors import InputError
from contact_locking.script_names import in_script, script_names
from contact_locking.study_file.parameters import Parameters

PACKAGE = Path(contact_locking.__file__).parent
# What a script uses.  Adapted meshes and checkpoints are those of study files.
USED = ("laws", "fem", "supports", "contact", "problem", "solver", "results", "certificate")
ALONE = ("process/judgement.py", "process/problem_solver.py")
# Words for the terminal and names of files and of entries of the summary.
NOT_TOLD = ("results/in_words.py", "results/output_folder.py", "results/names.py")
NO_KEYS = re.compile(r"certificate\.(errors|constants\.friction|friction_reserve)|contact\.csv")

KEYS = re.compile(rf"(?<![\w./])({'|'.join(Parameters.model_fields)})\.[a-z]\w*(\.[a-z]\w*)*")


def told(path: Path) -> Iterator[str]:
    """The texts in a module that are messages: those with a space, without docstrings; and keys."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    firsts = [
        node.body[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
    ]
    docs = {id(first.value) for first in firsts if isinstance(first, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) not in docs and isinstance(node.value, str):
            yield node.value


@pytest.mark.serial
def test_every_key_in_a_message_of_the_core_has_a_name_in_scripts() -> None:
    paths = [path for name in USED for path in sorted((PACKAGE / name).rglob("*.py"))]
    texts = {
        (text, path.relative_to(PACKAGE).as_posix())
        for path in [*paths, *(PACKAGE / name for name in ALONE)]
        for text in told(path)
    }
    found = {(text, path) for text, path in texts if KEYS.search(text) and path not in NOT_TOLD}
    assert len(found) > 15
    left = {
        (in_script(text), path)
        for text, path in found
        if KEYS.search(NO_KEYS.sub("", in_script(text)))
    }
    assert left == set()


@pytest.mark.serial
@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("penalty.n: 1.8e+03 leaves about 1 %, and .inf nothing",
         "n=1.8e+03 leaves about 1 %, and math.inf nothing"),
        ("Try solver.method: interior_point, lower penalty.n or raise penalty.epsilon.",
         'Try settings.method="interior_point", lower n or raise compliance.'),
        ("lower penalty.n: rounding grows", "lower n: rounding grows"),
        ("contacts.0.friction is negative", "contacts.0.friction is negative"),
    ],
)  # fmt: skip
def test_names_of_a_script(text: str, named: str) -> None:
    assert in_script({"warnings": [text]}) == {"warnings": [named]}


@pytest.mark.serial
def test_errors_have_the_names_of_a_script() -> None:
    with pytest.raises(InputError, match="a larger n is needed") as raised, script_names():
        raise InputError("a larger penalty.n is needed", "solver.linear")
    assert raised.value.key == "settings.linear"
