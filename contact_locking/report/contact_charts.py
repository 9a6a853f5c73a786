"""What happens on Gamma_C: profiles along it in two dimensions, maps of it in three."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from contact_locking.plotting import contact_map, profile, style
from contact_locking.solution import ContactPoints

from .charts import WIDTH, Chart, chart
from contact_locking.plotting.snapshot import FloatArray, IntArray


def contact_charts(contact: ContactPoints, facets: IntArray) -> list[Chart]:
    """The charts in two or three dimensions; ``facets`` (m, d) are numbers of the points."""
    if contact.dim == 2:
        description = "Contact pressure, friction traction and its bound along the contact boundary"
        return [
            chart("tractions", description, 3.6, lambda figure: _profile(figure, contact, facets)),
            chart(
                "slip",
                "Tangential displacement and distance to the foundation along the contact boundary",
                2.6,
                lambda figure: _opening(figure, contact, facets),
            ),
        ]
    height = _map_height(contact)
    friction = np.linalg.norm(contact.traction, axis=1)
    friction_label = r"friction traction $|\sigma_\tau|$"
    return [
        chart(
            "pressure",
            "Map of the contact pressure, seen from the foundation",
            height,
            lambda figure: _map(
                figure, contact, facets, contact.pressure, r"contact pressure $-\sigma_\nu$"
            ),
        ),
        chart(
            "friction",
            "Map of the friction traction, seen from the foundation",
            height,
            lambda figure: _map(figure, contact, facets, friction, friction_label),
        ),
        chart(
            "states",
            "Map of open, sticking and slipping points, seen from the foundation",
            height,
            lambda figure: _state_map(figure, contact, facets),
        ),
    ]


def curves(count: int, facets: IntArray) -> list[IntArray]:
    """``count`` points, sorted along curves made of segments (m, 2), as the numbers of each."""
    joined = np.zeros(count, dtype=bool)
    first, last = facets.min(axis=1), facets.max(axis=1)
    joined[first[last == first + 1]] = True
    return np.split(np.arange(count), np.flatnonzero(~joined[:-1]) + 1)


def _profile(figure: Figure, contact: ContactPoints, facets: IntArray) -> None:
    axes, strip = figure.subplots(2, 1, height_ratios=(1.0, 0.07))
    parts = curves(len(contact.x), facets)
    positions, label = profile.abscissa([contact.x[part] for part in parts])
    lines = [
        profile.Curve(
            s,
            contact.pressure[part],
            np.sum(contact.traction[part] * _tangents(contact.x[part], s), axis=1),
            contact.bound[part],
            contact.state[part],
        )
        for s, part in zip(positions, parts, strict=True)
    ]
    profile.draw(axes, strip, lines, label)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)


def _opening(figure: Figure, contact: ContactPoints, facets: IntArray) -> None:
    axes = figure.add_subplot()
    parts = curves(len(contact.x), facets)
    positions, label = profile.abscissa([contact.x[part] for part in parts])
    for number, (s, part) in enumerate(zip(positions, parts, strict=True)):
        slip = np.sum(contact.u_tangent[part] * _tangents(contact.x[part], s), axis=1)
        distance = contact.gap[part] - contact.u_normal[part]
        name = (lambda text: text) if number == 0 else (lambda text: "_" + text)
        axes.plot(s, slip, color=style.VERMILION, lw=1.6, label=name(r"tangential $u_\tau$"))
        axes.plot(s, distance, color=style.BLUE, lw=1.8, label=name(r"distance $g - u_\nu$"))
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.margins(x=0.0)
    axes.set_xlabel(label, loc="left")
    axes.set_ylabel("length")
    figure.legend(loc="outside upper left", ncols=2)


def _tangents(x: FloatArray, s: FloatArray) -> FloatArray:
    """Unit tangents (k, 2) of a curve that point to where the abscissa grows."""
    if len(x) < 2:
        return np.array([[1.0, 0.0]] * len(x))
    tangent = np.gradient(x, axis=0)
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    direction = 1.0 if s[-1] >= s[0] else -1.0
    return direction * tangent / np.where(length > 0.0, length, 1.0)


def _map_height(contact: ContactPoints) -> float:
    i, j, _ = contact_map.frame(contact)
    width, height = np.ptp(contact.x[:, [i, j]], axis=0)
    return float(np.clip(0.85 * WIDTH * height / (width or 1.0), 2.0, 6.0)) + 0.9


def _map(
    figure: Figure, contact: ContactPoints, facets: IntArray, values: FloatArray, label: str
) -> None:
    axes = figure.add_subplot(aspect="equal")
    colours = contact_map.colour_values(
        axes, contact, facets, values, cmap="cividis", vmin=0.0, rasterized=True
    )
    figure.colorbar(colours, ax=axes, orientation="horizontal", label=label, aspect=40, pad=0.02)


def _state_map(figure: Figure, contact: ContactPoints, facets: IntArray) -> None:
    axes = figure.add_subplot(aspect="equal")
    contact_map.colour_states(axes, contact, facets, rasterized=True)
    figure.legend(handles=style.state_patches(), loc="outside lower center", ncols=3)
