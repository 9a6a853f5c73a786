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
from contact_locking.extras.pictures.snapshot import ContactMap, Snapshot
from contact_locking.results.contact_points import STATE_NAMES, ContactPoints

# No snapshot is as large.  A small file that is compressed may fill the memory.
_MOST_BYTES = 20_000_000_000


def _by_name(text: str) -> dict[str, str]:
    return dict(pair.split() for pair in text.split(", "))


# Letters for the sizes: v vertices, c cells with s corners, b facets of the boundary, k points and
# m facets of Gamma_C, d dimensions.
_BODY = _by_name(
    "x vd, displacement vd, cells cs, boundary bd, boundary_cell b, strain_norm c, "
    "locking_limit c, locked c"
)
_POINTS = _by_name(
    "x kd, normal kd, u_normal k, u_tangent kd, gap k, pressure k, traction kd, bound k, "
    "state k, contact k"
)
_MAP = _by_name("facets md, vertices k, smoothed k")
# Whole numbers, and the size that they are smaller than.
_COUNTED = _by_name(
    "cells v, boundary v, boundary_cell c, facets k, vertices v, state states, contact k"
)
_UNBOUNDED = ("strain_norm", "locking_limit")
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
    known: dict[str, Any] = {name: kind(getattr(body, name)) for name, kind in _FACTS.items()}
    facts = json.dumps(known | {"contacts": body.contact.names, "bodies": body.contact.bodies})
    try:
        with path.open("wb") as stream:
            write = np.savez_compressed if compressed else np.savez
            write(stream, facts=np.array(facts), **arrays)
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def load(path: Path) -> Snapshot:
    """Read a snapshot. Raises InputError if there is none or it is damaged."""
    try:
        if sum(entry.file_size for entry in zipfile.ZipFile(path).infolist()) > _MOST_BYTES:
            raise InputError(f"{path}: is too large to be a snapshot")
        with np.load(path, allow_pickle=False) as archive:
            stored = {name: archive[name] for name in archive.files}
        return _snapshot(stored)
    except FileNotFoundError:
        raise InputError(
            f"{path}: there is no such file; solve again with output.picture: true"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except _DAMAGE as error:
        raise InputError(f"{path}: is damaged ({error}); solve again") from None


def _snapshot(stored: Mapping[str, npt.NDArray[Any]]) -> Snapshot:
    facts = json.loads(str(stored["facts"]))
    if not isinstance(facts, dict):
        raise ValueError("facts are no mapping")
    sizes = {"states": len(STATE_NAMES)}
    body: dict[str, Any] = {
        name: _checked(name, stored[name], shape, sizes) for name, shape in _BODY.items()
    }
    if sizes["d"] not in (2, 3) or sizes["s"] != sizes["d"] + 1 or not sizes["v"]:
        raise ValueError("no body in two or three dimensions")
    contact = ContactMap.none(sizes["d"])
    if "facets" in stored:
        contact = _contact(stored, sizes, facts.get("contacts"), facts.get("bodies", []))
    known: dict[str, Any] = {name: kind(facts[name]) for name, kind in _FACTS.items()}
    return Snapshot(**body, **known, contact=contact)


def _contact(
    stored: Mapping[str, npt.NDArray[Any]], sizes: dict[str, int], names: Any, bodies: Any
) -> ContactMap:
    arrays = {
        name: _checked(name, stored[f"points.{name}"], shape, sizes)
        for name, shape in _POINTS.items()
    }
    maps = {name: _checked(name, stored[name], shape, sizes) for name, shape in _MAP.items()}
    points = ContactPoints(**arrays)
    joins = points.contact[maps["facets"]]
    if (np.diff(points.contact) < 0).any():
        raise ValueError("the points are not sorted by contact")
    if (joins != joins[:, :1]).any():
        raise ValueError("a facet joins points of different contacts")
    count = len(points.rows())
    if not isinstance(names, list) or len(names) != count:
        raise ValueError("the contacts have no names")
    if not isinstance(bodies, list) or len(bodies) not in (0, count):
        raise ValueError("it does not tell which contacts are with bodies")
    tools = [stored[f"tool.{number}"] for number in range(count)]
    checked = [_checked("tool", tool, "tdd", sizes | {"t": len(tool)}) for tool in tools]
    return ContactMap(
        points,
        **maps,
        names=tuple(map(str, names)),
        tools=tuple(checked),
        bodies=tuple(map(bool, bodies)),
    )


def _checked(
    name: str, array: npt.NDArray[Any], shape: str, sizes: dict[str, int]
) -> npt.NDArray[Any]:
    """The array, if its kind is right and its sizes agree with ``sizes``, which it adds to."""
    if array.ndim != len(shape):
        raise ValueError(f"{name} has the wrong shape")
    for letter, size in zip(shape, array.shape, strict=True):
        if sizes.setdefault(letter, size) != size:
            raise ValueError(f"{name} has the wrong shape")
    if name == "locked":
        return array.astype(bool)
    if name in _COUNTED:
        if not np.issubdtype(array.dtype, np.integer):
            raise ValueError(f"{name} holds no whole numbers")
        if array.size and not 0 <= array.min() <= array.max() < sizes[_COUNTED[name]]:
            raise ValueError(f"{name} names what is not there")
        return array.astype(np.int64)
    array = array.astype(np.float64)
    if name not in _UNBOUNDED and not np.isfinite(array).all():
        raise ValueError(f"{name} is not finite")
    return array
