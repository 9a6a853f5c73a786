"""Charts of each contact: profiles along its curves in two dimensions, maps in three."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.figure import Figure

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.plotting import contact_map, profile, style
from contact_locking.results.contact_points import ContactPoints, contact_name, facets_within
from contact_locking.results.ordering import curves
from contact_locking.results.read import RunResults

from .charts import WIDTH, Chart, chart


def contact_charts(run: RunResults) -> list[tuple[str, list[Chart]]]:
    """The charts of each contact, with the name of the contact if there are several."""
    found = []
    rows = run.contact.rows()
    largest = float(run.contact.pressure.max(initial=0.0))
    for number, own in enumerate(rows):
        points, facets = run.contact[own], facets_within(run.facets, own)
        draw = partial(_profiles, largest) if points.dim == 2 else _maps
        if len(rows) == 1:
            found.append(("", draw(points, facets, "", "")))
        else:
            name = contact_name(run.summary, int(points.contact[0]))
            found.append((name, draw(points, facets, f"-{number + 1}", f": {name}")))
    return found


def _profiles(
    largest: float, contact: ContactPoints, facets: IntArray, ending: str, name: str
) -> list[Chart]:
    """The charts in two dimensions: tractions, and displacements.

    ``largest`` is the largest pressure of all contacts.
    """
    return [
        chart(
            f"tractions{ending}",
            "Contact pressure, friction traction and its bound along the contact boundary" + name,
            3.6,
            lambda figure: _profile(figure, contact, facets, largest),
        ),
        chart(
            f"slip{ending}",
            "Tangential displacement and distance to the foundation along the contact boundary"
            + name,
            2.6,
            lambda figure: _opening(figure, contact, facets),
        ),
    ]


def _maps(contact: ContactPoints, facets: IntArray, ending: str, name: str) -> list[Chart]:
    """The charts in three dimensions: pressure, friction and states."""
    height = _map_height(contact)
    friction = np.linalg.norm(contact.traction, axis=1)
    friction_label = r"friction traction $|\sigma_\tau|$"
    return [
        chart(
            f"pressure{ending}",
            "Map of the contact pressure, seen from the foundation" + name,
            height,
            lambda figure: _map(
                figure, contact, facets, contact.pressure, r"contact pressure $-\sigma_\nu$"
            ),
        ),
        chart(
            f"friction{ending}",
            "Map of the friction traction, seen from the foundation" + name,
            height,
            lambda figure: _map(figure, contact, facets, friction, friction_label),
        ),
        chart(
            f"states{ending}",
            "Map of open, sticking and slipping points, seen from the foundation" + name,
            height,
            lambda figure: _state_map(figure, contact, facets),
        ),
    ]


def _profile(figure: Figure, contact: ContactPoints, facets: IntArray, largest: float) -> None:
    axes, strip = figure.subplots(2, 1, height_ratios=(1.0, 0.07))
    parts = curves(facets)
    positions, label = profile.abscissa([contact.x[part] for part in parts])
    lines = [
        profile.Curve(
            s,
            contact.pressure[part],
            profile.along(contact.traction[part], contact.x[part], s),
            contact.bound[part],
            contact.state[part],
        )
        for s, part in zip(positions, parts, strict=True)
    ]
    profile.draw(axes, strip, lines, label, largest)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)


def _opening(figure: Figure, contact: ContactPoints, facets: IntArray) -> None:
    axes = figure.add_subplot()
    parts = curves(facets)
    positions, label = profile.abscissa([contact.x[part] for part in parts])
    for number, (s, part) in enumerate(zip(positions, parts, strict=True)):
        slip = profile.along(contact.u_tangent[part], contact.x[part], s)
        distance = contact.gap[part] - contact.u_normal[part]
        name = (lambda text: text) if number == 0 else (lambda text: "_" + text)
        axes.plot(s, slip, color=style.VERMILION, lw=1.6, label=name(r"tangential $u_\tau$"))
        axes.plot(s, distance, color=style.BLUE, lw=1.8, label=name(r"distance $g - u_\nu$"))
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.margins(x=0.0)
    axes.set_xlabel(label, loc="left")
    axes.set_ylabel("length")
    figure.legend(loc="outside upper left", ncols=2)


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
