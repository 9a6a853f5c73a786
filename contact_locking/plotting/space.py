"""The picture of a body in three dimensions: a sheet with views that PyVista has drawn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from contact_locking.plotting import contact_map, style
from contact_locking.plotting.film_look import FILM_WIDTH, Look
from contact_locking.plotting.sheet import Sheet
from contact_locking.plotting.snapshot import ContactMap, Snapshot
from contact_locking.plotting.views import (
    BODY,
    CUT,
    LOCKED,
    WIDTH,
    Image,
    View,
    contact_view,
    side_view,
    views,
)
from contact_locking.results.contact_points import STICK

# Inches: margins, the head of the sheet, a title, and the scale or the legend below a view.
_MARGIN, _HEAD, _TITLE, _BELOW = 0.2, 0.8, 0.3, 0.8
_LEFT, _RIGHT = _MARGIN, WIDTH + 2 * _MARGIN
# A scale of colours, and the numbers at the axes of a map.
_BAR, _NUMBERS = 1.6, 0.5


def figure(body: Snapshot, images: Mapping[str, Image]) -> Figure:
    """The body and its inside, and below them for each contact its pressure and its states."""
    seen = views(body)
    contacts = {contact_view(i): contact for i, contact in enumerate(body.contact.parts())}
    rows = [_TITLE + seen[name].height + _BELOW for name in (BODY, *contacts)]
    sheet = Sheet(2 * WIDTH + 3 * _MARGIN, _HEAD + sum(rows))
    style.head(sheet.figure, body)
    top = _HEAD + _TITLE
    scale = style.scale_words(style.magnification(body))
    sheet.view(seen[BODY], images[BODY], _LEFT, top, f"Deformed body, {scale}")
    inside, title = (LOCKED, style.LOCKED_TITLE) if LOCKED in seen else (CUT, "Cut open")
    sheet.view(seen[inside], images[inside], _RIGHT, top, title)
    top += seen[BODY].height
    shade = style.shade(body)
    sheet.bar(ScalarMappable(shade.norm, shade.cmap), _LEFT, top, _BAR, shade.extend, shade.label)
    if body.locked.any():
        rim = Line2D([], [], color=style.VERMILION, lw=1.6, label=style.RIM_LABEL)
        sheet.legend([rim], _LEFT + _BAR + _MARGIN, top)
    sheet.legend(_handles(body), _RIGHT, top)
    for name, contact in contacts.items():
        top += _BELOW + _TITLE
        _contact(sheet, body, contact, seen[name], images[name], top)
        top += seen[name].height
    return sheet.figure


def frames(
    bodies: Sequence[Snapshot], images: Sequence[Image], look: Look, titles: Sequence[str]
) -> Iterator[Figure]:
    """The pictures of an animation, each with its title and the scale of colours."""
    view, shown = side_view(bodies, look.factor, FILM_WIDTH), np.minimum.reduce(images)
    for image, shade, title in zip(images, look.shades, titles, strict=True):
        sheet = Sheet(view.width + 2 * _MARGIN, _TITLE + view.height + _BELOW)
        sheet.view(view, image, _MARGIN, _TITLE, title, shown)
        colours = ScalarMappable(shade.norm, shade.cmap)
        sheet.bar(colours, _MARGIN, _TITLE + view.height, _BAR, shade.extend, shade.label)
        yield sheet.figure


def _handles(body: Snapshot) -> list[Any]:
    found: list[Any] = [Line2D([], [], color=style.GREY, lw=0.9, label="undeformed")]
    if len(body.contact.points):
        found.append(Patch(facecolor=style.PALE, edgecolor=style.GREY, label="foundation"))
    if body.locked.any():
        found.append(Patch(facecolor=style.VERMILION, label="at the limit"))
    return found


def _contact(
    sheet: Sheet, body: Snapshot, contact: ContactMap, view: View, image: Image, top: float
) -> None:
    points = contact.points
    title = contact.titled(contact_map.PRESSURE_TITLE)
    axes = sheet.view(view, image, _LEFT, top, title)
    handles: list[Any] = []
    shown = contact_map.slipping(points)
    if len(shown):
        x = style.deformed(body, style.magnification(body))[contact.vertices[shown]]
        tails, heads = view.place(x), view.place(x + points.u_tangent[shown])
        contact_map.arrows(axes, tails, heads - tails)
        label = contact_map.slip_label(points, shown)
        handles.append(Line2D([], [], color="white", mec=style.BLACK, marker=">", label=label))
    if (points.state == STICK).any():
        handles.append(Line2D([], [], color=style.BLUE, lw=1.6, label="stick zone"))
    below = top + view.height
    norm = contact_map.pressure_norm(points)
    colours = ScalarMappable(norm, contact_map.PRESSURE_COLOURS)
    sheet.bar(colours, _LEFT, below, _BAR, label=contact_map.PRESSURE_LABEL)
    sheet.legend(handles, _LEFT + _BAR + _MARGIN, below, in_a_row=False)
    place = sheet.place(_RIGHT + _NUMBERS, top, WIDTH - _NUMBERS, view.height - _NUMBERS)
    contact_map.state_map(sheet.figure, place, contact)
    sheet.legend(style.state_patches(), _RIGHT + _NUMBERS, below)
