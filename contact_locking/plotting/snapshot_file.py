"""Snapshots as compressed NumPy files, read with the suspicion that files from anywhere deserve."""

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
from contact_locking.plotting.snapshot import ContactMap, Snapshot
from contact_locking.solution import STATE_NAMES, ContactPoints

# Far above any snapshot of ours: a small file may unpack to more than the memory.
_MOST_BYTES = 20_000_000_000

# Letters for the sizes: v vertices, c cells with s corners, b facets of the boundary, k points and
# m facets of Gamma_C, d dimensions.
_BODY = {
    "x": "vd",
    "displacement": "vd",
    "cells": "cs",
    "boundary": "bd",
    "boundary_cell": "b",
    "strain_norm": "c",
    "locking_limit": "c",
    "locked": "c",
}
_POINTS = {
    "x": "kd",
    "normal": "kd",
    "u_normal": "k",
    "u_tangent": "kd",
    "gap": "k",
    "pressure": "k",
    "traction": "kd",
    "bound": "k",
    "state": "k",
}
_MAP = {"facets": "md", "vertices": "k", "smoothed": "k"}
# What whole numbers count: they are smaller than this size.
_COUNTED = {
    "cells": "v",
    "boundary": "v",
    "boundary_cell": "c",
    "facets": "k",
    "vertices": "v",
    "state": "states",
}
_UNBOUNDED = ("strain_norm", "locking_limit")
_FACTS = {"title": str, "dofs": int, "locked_fraction": float, "converged": bool}

# What NumPy, zipfile and json raise for content that is not as they left it.
_DAMAGE = (
    *(ValueError, KeyError, TypeError, EOFError, OverflowError, MemoryError, RecursionError),
    *(zipfile.BadZipFile, zlib.error),
)


def save(body: Snapshot, path: Path) -> None:
    """Write a snapshot, all of it or nothing. Raises OSError."""
    arrays: dict[str, Any] = {name: getattr(body, name) for name in _BODY}
    if body.contact is not None:
        arrays |= {f"points.{name}": getattr(body.contact.points, name) for name in _POINTS}
        arrays |= {name: getattr(body.contact, name) for name in _MAP}
    facts = json.dumps({name: kind(getattr(body, name)) for name, kind in _FACTS.items()})
    try:
        with path.open("wb") as stream:
            np.savez_compressed(stream, facts=np.array(facts), **arrays)
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
    contact = None
    if "facets" in stored:
        points = {
            name: _checked(name, stored[f"points.{name}"], shape, sizes)
            for name, shape in _POINTS.items()
        }
        maps = {name: _checked(name, stored[name], shape, sizes) for name, shape in _MAP.items()}
        contact = ContactMap(ContactPoints(**points), **maps)
    known: dict[str, Any] = {name: kind(facts[name]) for name, kind in _FACTS.items()}
    return Snapshot(**body, **known, contact=contact)


def _checked(
    name: str, array: npt.NDArray[Any], shape: str, sizes: dict[str, int]
) -> npt.NDArray[Any]:
    """An array of the right kind whose sizes agree with those before it."""
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
