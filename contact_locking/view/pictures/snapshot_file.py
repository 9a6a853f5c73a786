"""Snapshots as compressed NumPy files; no file is trusted to be as it was written."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking.errors import InputError
from contact_locking.plain_text import defect
from contact_locking.results.contact_points import STATE_NAMES, ContactPoints
from contact_locking.view.pictures.snapshot import ContactMap, Snapshot


def _by_name(text: str) -> dict[str, str]:
    return dict(pair.split() for pair in text.split(", "))


# Letters for the sizes: v vertices, c cells with s corners, b facets of the boundary, k points and
# m facets of Gamma_C, n states, d dimensions.  Whole numbers are smaller than the size after <,
# truths have ?, and numbers that may be infinite ~.
_BODY = _by_name(
    "x vd, displacement vd, cells cs<v, boundary bd<v, boundary_cell b<c, strain_norm c~, "
    "locking_limit c~, locked c?"
)
_POINTS = _by_name(
    "x kd, normal kd, u_normal k, u_tangent kd, gap k, pressure k, traction kd, bound k, "
    "state k<n, contact k<k"
)
_MAP = _by_name("facets md<k, vertices k<v, smoothed k")
_FACTS = {"title": str, "dofs": int, "locked_fraction": float, "converged": bool}

# The errors of NumPy, zipfile and json for a damaged file.
_DAMAGE = (
    *(ValueError, KeyError, TypeError, EOFError, OverflowError, MemoryError, RecursionError),
    *(zipfile.BadZipFile, zlib.error),
)


def save(body: Snapshot, path: Path, compressed: bool = True) -> None:
    """Write a snapshot, all of it or nothing. Raises OSError."""
    arrays: dict[str, Any] = {name: getattr(body, name) for name in _BODY}
    if len(body.contact.points):
        arrays |= {f"points.{name}": getattr(body.contact.points, name) for name in _POINTS}
        arrays |= {name: getattr(body.contact, name) for name in _MAP}
        tools = enumerate(body.contact.tools)
        arrays |= {f"tool.{number}": facets for number, facets in tools}
    facts: dict[str, Any] = {name: kind(getattr(body, name)) for name, kind in _FACTS.items()}
    facts |= {"contacts": body.contact.names, "bodies": body.contact.bodies}
    try:
        with path.open("wb") as stream:
            write = np.savez_compressed if compressed else np.savez
            write(stream, facts=np.array(json.dumps(facts)), **arrays)
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def load(path: Path) -> Snapshot:
    """Read a snapshot. Raises InputError if there is none or it is damaged."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return _snapshot({name: archive[name] for name in archive.files})
    except FileNotFoundError:
        raise InputError(
            f"{path}: there is no such file; solve again with output.picture: true"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except _DAMAGE as error:
        raise InputError(f"{path}: is damaged ({defect(error)}); solve again") from None


def _snapshot(stored: Mapping[str, npt.NDArray[Any]]) -> Snapshot:
    facts = json.loads(str(stored["facts"]))
    sizes = {"n": len(STATE_NAMES)}

    def arrays(shapes: Mapping[str, str], before: str = "") -> dict[str, Any]:
        return {
            name: _checked(name, stored[f"{before}{name}"], shape, sizes)
            for name, shape in shapes.items()
        }

    body = arrays(_BODY)
    if sizes["d"] not in (2, 3) or sizes["s"] != sizes["d"] + 1 or not sizes["v"]:
        raise ValueError("no body in two or three dimensions")
    contact = ContactMap.none(sizes["d"])
    if "facets" in stored:
        points, maps = ContactPoints(**arrays(_POINTS, "points.")), arrays(_MAP)
        joins = points.contact[maps["facets"]]
        if (np.diff(points.contact) < 0).any():
            raise ValueError("the points are not sorted by contact")
        if (joins != joins[:, :1]).any():
            raise ValueError("a facet joins points of different contacts")
        names, bodies = facts["contacts"], facts["bodies"]
        if not len(points.rows()) == len(names) == len(bodies):
            raise ValueError("the contacts have no names")
        tools = [
            _checked("tool", stored[f"tool.{number}"], "tdd", {"d": sizes["d"]})
            for number in range(len(names))
        ]
        contact = ContactMap(
            points,
            **maps,
            names=tuple(map(str, names)),
            tools=tuple(tools),
            bodies=tuple(map(bool, bodies)),
        )
    known: dict[str, Any] = {name: kind(facts[name]) for name, kind in _FACTS.items()}
    return Snapshot(**body, **known, contact=contact)


def _checked(name: str, array: npt.NDArray[Any], shape: str, sizes: dict[str, int]) -> Any:
    """The array, if its kind is right and its sizes agree with ``sizes``, which it adds to."""
    axes = shape.rstrip("?~").partition("<")[0]
    if array.ndim != len(axes) or any(
        sizes.setdefault(letter, size) != size
        for letter, size in zip(axes, array.shape, strict=True)
    ):
        raise ValueError(f"{name} has the wrong shape")
    if shape.endswith("?"):
        return array.astype(bool)
    if "<" in shape:
        if not np.issubdtype(array.dtype, np.integer):
            raise ValueError(f"{name} holds no whole numbers")
        if array.size and not 0 <= array.min() <= array.max() < sizes[shape[-1]]:
            raise ValueError(f"{name} names what is not there")
        return array.astype(np.int64)
    array = array.astype(np.float64)
    if not shape.endswith("~") and not np.isfinite(array).all():
        raise ValueError(f"{name} is not finite")
    return array
