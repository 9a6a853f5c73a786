"""Tools of triangles, and the STL files that hold them."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray


def box(low: list[float], high: list[float]) -> FloatArray:
    """The corners (12, 3, 3) of the triangles of a box, counterclockwise seen from outside."""
    sides = []
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3]
        for end, order in ((1.0, (0, 1, 2, 3)), (0.0, (0, 3, 2, 1))):
            square = np.full((4, 3), end)
            square[:, others] = [(0, 0), (1, 0), (1, 1), (0, 1)]
            a, b, c, d = square[list(order)]
            sides += [[a, b, c], [a, c, d]]
    return np.asarray(low) + np.array(sides) * (np.asarray(high) - low)


def ball(radius: float, centre: FloatArray, count: int) -> FloatArray:
    """A ball of about ``2 count**2`` triangles (n, 3, 3) between meridians and parallels."""
    polar = np.linspace(0.0, np.pi, count // 2 + 1)
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    sine = np.sin(polar)[:, None]
    sine[[0, -1]] = 0.0
    grid = np.stack(
        [sine * np.cos(around), sine * np.sin(around), np.cos(polar)[:, None] + 0.0 * around], -1
    )
    a, b = grid[:-1], grid[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    lower = np.stack([a, b, c], axis=2)[:-1].reshape(-1, 3, 3)
    upper = np.stack([a, c, d], axis=2)[1:].reshape(-1, 3, 3)
    return centre + radius * np.concatenate([lower, upper])


def ascii_stl(triangles: FloatArray) -> bytes:
    """The triangles (n, 3, 3) as a text file."""
    lines = ["solid tool"]
    for corners in triangles:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x:.17g} {y:.17g} {z:.17g}" for x, y, z in corners]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid tool", ""]).encode()


def binary_stl(triangles: FloatArray, count: int | None = None) -> bytes:
    """The triangles (n, 3, 3) as a binary file, which says ``count`` triangles, if given."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    records = np.zeros(len(triangles), dtype=record)
    records["corners"] = triangles
    number = len(triangles) if count is None else count
    return bytes(80) + number.to_bytes(4, "little") + records.tobytes()
