"""A page that needs nothing but itself: styles, script and pictures are in it."""

from __future__ import annotations

import base64
import hashlib
from importlib import resources

from contact_locking._version import __version__

from . import GENERATOR
from .markup import Content, Markup, element

DESCRIPTION = "Frictional contact of elastic-locking bodies"


def page(title: str, *content: Content) -> str:
    """A whole HTML document.

    Its policy lets a browser run the script of this package only, and load nothing from anywhere.
    """
    script, style = _resource("page.js"), _resource("page.css")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = (
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
        f"script-src 'sha256-{digest}'"
    )
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name_="generator", content=f"{GENERATOR} {__version__}"),
        element("title", title),
        element("style", Markup(style)),
        # An icon of its own keeps a browser from asking for one.
        Markup('<link rel="icon" href="data:,">'),
    )
    body = element("body", element("h1", title), content, element("script", Markup(script)))
    return f"<!DOCTYPE html>\n{element('html', head, body, lang='en')}\n"


def _resource(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
