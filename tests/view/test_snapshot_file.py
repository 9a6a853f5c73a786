"""What is to be drawn is read as it was saved, and a file that is damaged is bad input."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from solutions import KINDS, snapshot

from contact_locking.errors import InputError
from contact_locking.view.pictures import snapshot_file


def same(a: Any, b: Any) -> bool:
    if is_dataclass(a):
        return all(same(getattr(a, field.name), getattr(b, field.name)) for field in fields(a))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return bool(a == b)


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_a_snapshot_is_read_as_it_was_saved(dim: int, kind: str, tmp_path: Path) -> None:
    body = snapshot(dim, kind)
    snapshot_file.save(body, tmp_path / "snapshot.npz")
    assert same(snapshot_file.load(tmp_path / "snapshot.npz"), body)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"cells": lambda cells: cells[:, :3]}, "wrong shape|no body"),
        ({"cells": lambda cells: cells + 1000}, "cells names what is not there"),
        ({"boundary_cell": lambda cells: cells - 1}, "boundary_cell names what is not there"),
        ({"facets": lambda facets: facets.astype(float)}, "facets holds no whole numbers"),
        ({"x": lambda x: x * np.nan}, "x is not finite"),
        ({"displacement": lambda u: u[1:]}, "displacement has the wrong shape"),
        ({"points.gap": lambda gap: gap[:, None]}, "gap has the wrong shape"),
        ({"facts": lambda facts: np.array("{}")}, "without .contacts"),
        ({"facts": lambda facts: np.array("[" * 100_000)}, "damaged"),
        ({"facts": lambda facts: np.array([{}], dtype=object)}, "pickle"),
    ],
)
def test_a_snapshot_that_is_damaged_is_bad_input(
    change: dict[str, Any], told: str, tmp_path: Path
) -> None:
    path = tmp_path / "snapshot.npz"
    snapshot_file.save(snapshot(), path)
    with np.load(path) as archive:
        stored = dict(archive)
    np.savez(path, **{name: change.get(name, np.asarray)(stored[name]) for name in stored})
    with pytest.raises(InputError, match=told):
        snapshot_file.load(path)


@pytest.mark.serial
def test_a_snapshot_of_two_contacts_that_a_facet_joins_is_bad_input(tmp_path: Path) -> None:
    path, body = tmp_path / "snapshot.npz", snapshot(3, "with two contacts")
    body.contact.points.contact[-1] = 0
    snapshot_file.save(body, path)
    with pytest.raises(InputError, match="sorted by contact"):
        snapshot_file.load(path)
    body.contact.points.contact[:] = 1
    body.contact.points.contact[0] = 0
    snapshot_file.save(body, path)
    with pytest.raises(InputError, match="a facet joins"):
        snapshot_file.load(path)


@pytest.mark.serial
def test_a_file_that_is_no_snapshot_is_bad_input(tmp_path: Path) -> None:
    path = tmp_path / "snapshot.npz"
    with pytest.raises(InputError, match=r"no such file; solve again with output\.picture"):
        snapshot_file.load(path)
    snapshot_file.save(snapshot(), path)
    content = path.read_bytes()
    for damaged in (b"", b"text", content[: len(content) // 2], content[:-30]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="is damaged"):
            snapshot_file.load(path)
