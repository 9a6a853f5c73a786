"""Parts of the reference that are made from the code when the site is built.

A page says where by a comment, such as ``<!-- study file keys -->``.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterator
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

from contact_locking.command import cli
from contact_locking.results.quantities import QUANTITIES
from contact_locking.study_file.schema import Row, rows


def study_file_keys() -> str:
    """A table of keys for each section, below a heading."""
    parts = []
    for section, keys in groupby(rows(), key=lambda row: row.key.partition(".")[0]):
        first, *others = keys
        lines = [f"## {section}", "", f"{_sentence(first.description)}", ""]
        if others:
            lines += ["| key | default | unit | meaning |", "| --- | --- | --- | --- |"]
            lines += map(_line, others)
        else:
            lines += [f"Default: {_code(first.default)}"]
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def quantities(of: str) -> str:
    """A table of the quantities of the body, or of contacts, that the summary has."""
    lines = ["| key | unit | meaning |", "| --- | --- | --- |"]
    for key, quantity in QUANTITIES.items():
        if quantity.compute is not None and quantity.of == of:
            keys = f"`{key}`, `{key}_at`" if quantity.at else f"`{key}`"
            unit = "" if quantity.unit == "1" else quantity.unit
            lines.append(f"| {keys} | {unit} | {_plain(quantity.meaning)} |")
    return "\n".join(lines)


def command_line() -> str:
    """The help of every command."""
    parser = cli.parser()
    pages = [("contact-locking", parser), *commands(parser).items()]
    parts = []
    for name, command in pages:
        command.formatter_class = lambda prog: argparse.HelpFormatter(prog, width=88)
        title = name if command is parser else f"contact-locking {name}"
        parts.append(f"## {title}\n\n```text\n{command.format_help().rstrip()}\n```\n")
    return "\n".join(parts)


def commands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The parsers of the commands by name."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


CONTACTS = "<!-- quantities of contacts -->"
MARKS: dict[str, Callable[[], str]] = {
    "<!-- study file keys -->": study_file_keys,
    "<!-- command line -->": command_line,
    "<!-- quantities of the body -->": partial(quantities, "body"),
    CONTACTS: partial(quantities, "contact"),
}


def fill(text: str) -> str:
    """A page with its marks replaced."""
    for mark, make in MARKS.items():
        if mark in text:
            text = text.replace(mark, make())
    return text


def without_folders(text: str, page: Path) -> str:
    """A page with plain text for links to folders, which the repository shows and the site not."""

    def plain(link: re.Match[str]) -> str:
        return link[1] if (page.parent / link[2]).is_dir() else link[0]

    return re.sub(r"\[([^\]]*)\]\(([^)\s#:]+)\)", plain, text)


def setup(app: Any) -> dict[str, bool]:
    """Fill every page when Sphinx reads it."""

    def read(app: Any, page: str, source: list[str]) -> None:
        source[0] = fill(without_folders(source[0], Path(app.env.doc2path(page))))

    def outdated(_app: Any, env: Any, *_changes: Any) -> Iterator[str]:
        """The code may have changed, the page has not."""
        return (page for page in env.found_docs if page.startswith("reference/"))

    app.connect("source-read", read)
    app.connect("env-get-outdated", lambda *arguments: list(outdated(*arguments)))
    return {"parallel_read_safe": True}


def _line(row: Row) -> str:
    # Where a number has no unit the cell stays empty.
    unit = "" if row.unit == "1" else row.unit
    return f"| {_code(row.key)} | {_code(row.default)} | {unit} | {_plain(row.description)} |"


def _code(text: str) -> str:
    return f"`{_plain(text)}`" if text else ""


def _plain(text: str) -> str:
    """Without what Markdown takes for the end of a cell."""
    return text.replace("|", "\\|")


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."
