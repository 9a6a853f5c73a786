"""HTML from Jinja2 templates, which escape every text.

A page needs no other file: its style, script and pictures are inside.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import re
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from contact_locking._version import __version__

from .words import shown, title, words


def render(template: str, **context: Any) -> str:
    """A whole HTML document from a template of this package."""
    script = _resource("page.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return (
        environment()
        .get_template(template)
        .render(
            context,
            generator="contact_locking",
            version=__version__,
            style=Markup(_resource("page.css")),
            script=Markup(script),
            script_digest=digest,
        )
    )


@functools.cache
def environment() -> Environment:
    """The templates of this package, compiled once, with filters for values, keys and formulas."""
    made = Environment(
        loader=PackageLoader(str(__package__), "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {"shown": shown, "key": key, "formula": formula, "title": title, "words": words}
    return made


def key(name: str) -> Markup:
    """A dotted key as code; a line may break after a dot or an underscore."""
    return Markup("<code>{}</code>").format(_marked(r"(?<=[._])(?=.)", "<wbr>", name))


def formula(text: str) -> Markup:
    """A text whose indices of one letter are set as indices: the C in Gamma_C."""
    return _marked(r"_(\w)", r"<sub>\1</sub>", text)


def _marked(pattern: str, markup: str, text: str) -> Markup:
    """The escaped text with markup in place of a pattern."""
    return Markup(re.sub(pattern, markup, str(escape(text))))


def _resource(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
