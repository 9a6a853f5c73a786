"""Sphinx: `make docs` builds the site into docs/_build/html."""

from __future__ import annotations

import os
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
# Kernels that run the demos start elsewhere.
os.environ["PYTHONPATH"] = os.pathsep.join([str(DOCS.parent), os.environ.get("PYTHONPATH", "")])
sys.path[:0] = [str(DOCS.parent), str(DOCS / "_extensions")]

import contact_locking  # noqa: E402

project = "contact_locking"
author = "the authors of contact_locking"
version = release = contact_locking.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
extensions += ["generated_reference", "demo_notebooks", "mathml"]
exclude_patterns = ["_build", "_extensions", "**/.ipynb_checkpoints"]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
myst_update_mathjax = False
html_math_renderer = "mathml"

nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"FloatArray": "FloatArray"}
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = f"contact_locking {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False
