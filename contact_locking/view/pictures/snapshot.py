"""All that a picture shows, as arrays of NumPy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.results.contact_points import ContactPoints


@dataclass(frozen=True)
class ContactMap:
    """Gamma_C, which has no points in a body without contact.

    ``facets`` (m, d) are numbers of the points, ``vertices`` (k,) the points as vertices of the
    body, ``smoothed`` (k,) is R sigma_nu, and ``names`` are those of the contacts.  ``tools`` has
    for each contact the facets (t, d, d) of the surface of the tool at its place, by their corners,
    and none for a foundation that is drawn as far as Gamma_C sees it.  ``bodies`` tells which
    contacts are with another body, which is no foundation.
    """

    points: ContactPoints
    facets: IntArray
    vertices: IntArray
    smoothed: FloatArray
    names: tuple[str, ...]
    tools: tuple[FloatArray, ...]
    bodies: tuple[bool, ...]

    def parts(self) -> list[ContactMap]:
        """The map of each contact, which has a name if there are several."""
        return [
            ContactMap(
                self.points[own],
                facets_within(self.facets, own),
                self.vertices[own],
                self.smoothed[own],
                (self.names[number] if len(self.names) > 1 else "",),
                (self.tools[number],),
                (self.bodies[number],),
            )
            for number, own in enumerate(self.points.rows())
        ]

    def on_foundations(self) -> list[ContactMap]:
        """The maps of the contacts with foundations."""
        return [part for part in self.parts() if not any(part.bodies)]


@dataclass(frozen=True)
class Snapshot:
    """The body with v vertices, c cells and b boundary facets, numbered over all ranks.

    ``x`` and ``displacement`` are (v, d), ``cells`` (c, d + 1), ``boundary`` (b, d) and
    ``boundary_cell`` (b,); strain norm, locking limit and ``locked`` are (c,).
    """

    x: FloatArray
    displacement: FloatArray
    cells: IntArray
    boundary: IntArray
    boundary_cell: IntArray
    strain_norm: FloatArray
    locking_limit: FloatArray
    locked: npt.NDArray[np.bool_]
    contact: ContactMap
    title: str
    dofs: int
    locked_fraction: float
    converged: bool

    @property
    def dim(self) -> int:
        return int(self.x.shape[1])

    @property
    def size(self) -> float:
        """The longest edge of the body's bounding box."""
        return float(np.ptp(self.x, axis=0).max())


def save(body: Snapshot, path: Path) -> None:
    """Write a snapshot for another process, as a file of NumPy."""
    contact = body.contact
    owners = {"body": vars(body), "contact": vars(contact), "points": vars(contact.points)}
    arrays: dict[str, Any] = {
        f"{owner}.{name}": np.asarray(value)
        for owner, values in owners.items()
        for name, value in values.items()
        if name != "tools" and not isinstance(value, ContactMap | ContactPoints)
    }
    arrays |= {f"tools.{number:06}": facets for number, facets in enumerate(contact.tools)}
    with path.open("wb") as stream:
        np.savez(stream, **arrays)


def load(path: Path) -> Snapshot:
    """Read what :func:`save` has written."""
    owners: dict[str, dict[str, Any]] = {"body": {}, "contact": {}, "points": {}, "tools": {}}
    with np.load(path) as file:
        for key, value in file.items():
            owner, _, name = key.partition(".")
            owners[owner][name] = value if value.ndim else value.item()
    of_contact = owners["contact"]
    for name in ("names", "bodies"):
        of_contact[name] = tuple(of_contact[name].tolist())
    points, tools = ContactPoints(**owners["points"]), tuple(owners["tools"].values())
    return Snapshot(**owners["body"], contact=ContactMap(points, tools=tools, **of_contact))


def nearest_parts(x: FloatArray, facets: IntArray) -> tuple[FloatArray, IntArray]:
    """Divide facets (m, 3) of points x (k, e) into a part for each corner: shapes, and corners.

    The shapes are quadrilaterals (3 m, 4, e).
    """
    corners = x[facets]
    centre = corners.mean(axis=1)
    shapes = []
    for k in range(3):
        before, after = (0.5 * (corners[:, k] + corners[:, (k + s) % 3]) for s in (1, 2))
        shapes.append(np.stack([corners[:, k], before, centre, after], axis=1))
    return np.concatenate(shapes), facets.T.ravel()


# Reach of the drawn foundation beyond Gamma_C as a share of the body's size.
_REACH = 0.12
# A tool that reaches farther beyond the body, as a share of its size, and one of more facets, is
# drawn as far as Gamma_C sees it.
_FARTHEST, _MOST_FACETS = 1.5, 20_000
# Points are in a plane if their distance from the plane is below this share of their extent.
_PLANE = 1e-6


def touched(contact: ContactMap, factor: float) -> FloatArray:
    """The points (k, d) of the foundation below those of Gamma_C, at ``factor`` times the gap."""
    points = contact.points
    return points.x + factor * points.gap[:, None] * points.normal


def drawn_tool(outline: FloatArray, x: FloatArray) -> FloatArray:
    """The facets (t, d, d) of a tool if all of it is drawn beside the body x (v, d), else none."""
    low, high = x.min(axis=0), x.max(axis=0)
    reach = _FARTHEST * float((high - low).max())
    beside = np.all(outline >= low - reach) and np.all(outline <= high + reach)
    return outline if beside and len(outline) <= _MOST_FACETS else outline[:0]


def tool(contact: ContactMap, factor: float) -> FloatArray:
    """The facets (t, d, d) of the tool of one contact, if the picture has a true scale."""
    (facets,) = contact.tools
    return facets if factor == 1.0 else facets[:0]


def foundation(contact: ContactMap, factor: float, size: float) -> FloatArray:
    """The facets of a tool, or the surface at Gamma_C + gap nu (m, 3 or 4, 3).

    The surface is one rectangle if it is plane, else it has the facets of Gamma_C.
    """
    if len(facets := tool(contact, factor)):
        return facets
    surface = touched(contact, factor)
    centre = surface.mean(axis=0)
    _, spread, basis = np.linalg.svd(surface - centre, full_matrices=False)
    if spread[2] > _PLANE * spread[0]:
        return surface[contact.facets]
    # Along the axes of coordinates where the plane allows it.
    first = np.eye(3)[np.argmin(np.abs(basis[2]))]
    first = first - (first @ basis[2]) * basis[2]
    first /= np.linalg.norm(first)
    frame = np.array([first, np.cross(basis[2], first)])
    flat = (surface - centre) @ frame.T
    low, high = flat.min(axis=0) - _REACH * size, flat.max(axis=0) + _REACH * size
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return (centre + corners @ frame)[None]


def facets_within(facets: IntArray, rows: slice) -> IntArray:
    """The facets (m, d) of the contact with these rows, as numbers of the points of the contact."""
    own = (facets[:, 0] >= rows.start) & (facets[:, 0] < rows.stop)
    return facets[own] - rows.start
