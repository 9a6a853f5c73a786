"""The picture of a body in three dimensions: views that PyVista has drawn, on one page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from contact_locking.plotting import contact_map, style
from contact_locking.plotting.page import Page
from contact_locking.plotting.snapshot import ContactMap, Snapshot
from contact_locking.plotting.views import BODY, CONTACT, CUT, LOCKED, WIDTH, Image, View, views
from contact_locking.solution import STICK

# Inches: margins, the head of the page, a title, and what is below a view.
_MARGIN, _HEAD, _TITLE, _BELOW = 0.2, 0.8, 0.3, 0.6
_LEFT, _RIGHT = _MARGIN, WIDTH + 2 * _MARGIN
# A scale of colours, and the numbers at the axes of a map.
_BAR, _NUMBERS = 1.6, 0.5


def figure(body: Snapshot, images: Mapping[str, Image]) -> Figure:
    """The body and its inside over, if there is contact, Gamma_C seen from below."""
    seen = views(body)
    rows = [_TITLE + seen[name].height + _BELOW for name in (BODY, CONTACT) if name in seen]
    page = Page(2 * WIDTH + 3 * _MARGIN, _HEAD + sum(rows))
    style.head(page.figure, body)
    top = _HEAD + _TITLE
    scale = style.scale_words(style.magnification(body))
    page.view(seen[BODY], images[BODY], _LEFT, top, f"Deformed body, {scale}")
    inside, title = (LOCKED, style.LOCKED_TITLE) if LOCKED in seen else (CUT, "Cut open")
    page.view(seen[inside], images[inside], _RIGHT, top, title)
    top += seen[BODY].height
    shade = style.shade(body)
    page.bar(ScalarMappable(shade.norm, shade.cmap), _LEFT, top, _BAR, shade.extend, shade.label)
    page.legend(_handles(body), _RIGHT, top)
    if body.contact is not None:
        _contact(page, body, body.contact, seen[CONTACT], images[CONTACT], top + _BELOW + _TITLE)
    return page.figure


def _handles(body: Snapshot) -> list[Any]:
    found: list[Any] = [Line2D([], [], color=style.GREY, lw=0.9, label="undeformed")]
    if body.contact is not None:
        found.append(Patch(facecolor=style.PALE, edgecolor=style.GREY, label="foundation"))
    if body.locked.any():
        found.append(Patch(facecolor=style.VERMILION, label="locked zone"))
    return found


def _contact(
    page: Page, body: Snapshot, contact: ContactMap, view: View, image: Image, top: float
) -> None:
    points = contact.points
    axes = page.view(view, image, _LEFT, top, contact_map.PRESSURE_TITLE)
    handles: list[Any] = []
    shown = contact_map.slipping(points)
    if len(shown):
        x = style.deformed(body, style.magnification(body))[contact.vertices[shown]]
        tails, heads = view.place(x), view.place(x + points.u_tangent[shown])
        contact_map.arrows(axes, tails, heads - tails)
        handles.append(Line2D([], [], color="white", mec=style.BLACK, marker=">", label="slip"))
    if (points.state == STICK).any():
        handles.append(Line2D([], [], color=style.BLUE, lw=1.6, label="stick zone"))
    below = top + view.height
    norm = contact_map.pressure_norm(points)
    page.bar(ScalarMappable(norm, contact_map.PRESSURE_COLOURS), _LEFT, below, _BAR)
    page.legend(handles, _LEFT + _BAR + _MARGIN, below)
    place = page.place(_RIGHT + _NUMBERS, top, WIDTH - _NUMBERS, view.height - _NUMBERS)
    contact_map.state_map(page.figure, place, contact)
    page.legend(style.state_patches(), _RIGHT + _NUMBERS, below)
