"""The scripts in demos/ as notebooks that Sphinx executes: docs/demos/NAME.ipynb."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jupytext
from nbformat.v4 import new_code_cell, new_markdown_cell

ROOT = Path(__file__).resolve().parents[2]
RESULTS = "docs/_build/demos"

# A script knows its file and its words; a notebook is told, in a cell that is not shown.
_BEFORE = """\
import os, sys
os.chdir({root!r})
__file__ = {script!r}
sys.argv = [__file__, *{words!r}]"""
_PICTURE = """\
from IPython.display import Image
Image("{folder}/picture.png")"""
_AFTER = """\
## The picture and the study file

`picture.png`, as `contact-locking run demos/{name}.yml` draws it too:"""
_STUDY_FILE = """\
```{{literalinclude}} ../../demos/{name}.yml
:language: yaml
:caption: demos/{name}.yml
```"""


def notebook(script: Path) -> Any:
    """The notebook of a percent script, with the picture and the text of its study file, if any."""
    book = jupytext.read(script, fmt="py:percent")
    names = {"name": script.stem, "folder": f"{RESULTS}/{script.stem}"}
    has_study_file = script.with_suffix(".yml").exists()
    words = [f"output.directory={names['folder']}"] if has_study_file else []
    before = _BEFORE.format(root=str(ROOT), script=f"demos/{script.name}", words=words)
    hidden = new_code_cell(before, metadata={"tags": ["remove-cell"]})
    book.cells = [book.cells[0], hidden, *book.cells[1:]]
    if has_study_file:
        book.cells += [
            new_markdown_cell(_AFTER.format(**names)),
            new_code_cell(_PICTURE.format(**names), metadata={"tags": ["remove-input"]}),
            new_markdown_cell(_STUDY_FILE.format(**names)),
        ]
    for number, cell in enumerate(book.cells):
        cell.id = f"cell-{number}"
    book.metadata["kernelspec"] = {
        "name": "python3",
        "display_name": "Python",
        "language": "python",
    }
    return book


def write_notebooks(folder: Path) -> None:
    """One for each script, and none for a script that is gone."""
    scripts = sorted((ROOT / "demos").glob("*.py"))
    for old in set(folder.glob("*.ipynb")) - {folder / f"{path.stem}.ipynb" for path in scripts}:
        old.unlink()
    for path in scripts:
        jupytext.write(notebook(path), folder / f"{path.stem}.ipynb")


def setup(app: Any) -> dict[str, bool]:
    """Write them before Sphinx looks for pages."""
    app.connect("builder-inited", lambda app: write_notebooks(Path(app.srcdir) / "demos"))
    return {"parallel_read_safe": True}
