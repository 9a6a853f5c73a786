"""Every sentence with a word of proof is listed in docs/notes/claims.md, with what it rests on."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "docs/notes/claims.md"
WORDS = re.compile(
    r"\b(proved|proofs?|exact|exactly|guaranteed|always|never|any|unique|uniqueness)\b", re.I
)
MESSAGES = "messages and reports"


def pages() -> list[Path]:
    folders = ("docs", "docs/guides", "docs/reference", "docs/start")
    return [
        ROOT / "README.md",
        ROOT / "paper.md",
        *(path for folder in folders for path in sorted((ROOT / folder).glob("*.md"))),
    ]


def of_page(text: str) -> Iterator[str]:
    """The sentences of a page in Markdown, without its code."""
    text = re.sub(r"^---\n.*?^---\n|```.*?```|^    .*?$|<!--.*?-->", "", text, flags=re.S | re.M)
    # Rows of tables, items and headings are sentences of their own.
    for block in re.split(r"\n\s*\n|\n(?=\s*[-|#>*])", text):
        yield from re.split(r"(?<=[.:;?!])\s+", " ".join(block.split()))


def of_messages() -> Iterator[str]:
    """The texts in the package that users read: all but docstrings, and the templates."""
    for path in sorted((ROOT / "contact_locking").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        owners = (ast.Module, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
        docstrings = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, owners) and node.body and isinstance(node.body[0], ast.Expr)
        }
        for node in ast.walk(tree):
            text = node.value if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and id(node) not in docstrings and " " in text:
                yield " ".join(text.split())
    for path in sorted((ROOT / "contact_locking/view/report").glob("*.j2")):
        yield from of_page(re.sub(r"<[^>]*>|\{[{%#].*?[}%#]\}", " ", path.read_text()))


def sentences() -> dict[str, list[str]]:
    """The sentences with one of the words, by page."""
    found = {
        str(p.relative_to(ROOT)): list(of_page(p.read_text(encoding="utf-8"))) for p in pages()
    }
    found[MESSAGES] = list(of_messages())
    return {name: [s for s in texts if WORDS.search(s)] for name, texts in found.items()}


def quoted() -> dict[str, list[str]]:
    """The quotations of the table, by page; under "" those that claim nothing, for all pages."""
    found: dict[str, list[str]] = {}
    page = ""
    for line in TABLE.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            page = "" if "claim nothing" in line else line[3:].strip("`")
        elif line.startswith("| «"):
            found.setdefault(page, []).append(line.split("«")[1].split("»")[0])
    return found


def plain(text: str) -> str:
    return text.replace("\\|", "|")


def test_every_sentence_with_a_word_of_proof_is_in_the_table() -> None:
    table = quoted()
    missing = [
        f"{page}: {sentence}"
        for page, texts in sentences().items()
        for sentence in texts
        if not any(plain(q) in plain(sentence) for q in [*table.get(page, []), *table[""]])
    ]
    assert not missing, (
        "say in docs/notes/claims.md of what these sentences are claims, under which hypotheses "
        "and by which test, or write them without the word:\n" + "\n".join(missing)
    )


def test_every_quotation_of_the_table_is_in_a_sentence_of_its_page() -> None:
    found = sentences()
    everywhere = [plain(text) for texts in found.values() for text in texts]
    stale = [
        f"{page}: {quotation}"
        for page, quotations in quoted().items()
        for quotation in quotations
        if not any(
            plain(quotation) in text for text in (map(plain, found[page]) if page else everywhere)
        )
    ]
    assert not stale, "docs/notes/claims.md quotes what nobody says:\n" + "\n".join(stale)


def test_the_files_that_the_table_names_exist() -> None:
    named = re.findall(r"\b(?:test_[\w*]+\.py|\w+/[\w/]+\.\w+)", TABLE.read_text(encoding="utf-8"))
    gone = [name for name in named if not any([*ROOT.glob(name), *ROOT.glob(f"tests/**/{name}")])]
    assert named and not gone, f"docs/notes/claims.md names files that do not exist: {gone}"
