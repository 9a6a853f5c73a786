"""The files that a study file names, whose paths are relative to its folder."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from contact_locking.errors import InputError
from contact_locking.files.missing import similar
from contact_locking.mesh_file.stl import check_size
from contact_locking.parameters.base import MOST_FAULTS, Fault, Place

#: The shapes of a rigid body that may be in a file.
_SHAPES = ("surface", "polyline")


def with_absolute_paths(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Fault]]:
    """The data of a study file with absolute paths, and a fault for each file that is not there."""
    faults = []
    for place in _places(data):
        file = str(folder.absolute() / _at(data, place))
        # Not Path.is_file, which raises for a name that no file can have.
        if not os.path.isfile(file):
            if os.path.isdir(file):
                faults.append(Fault(place, f"is a folder: {file}"))
            elif os.path.exists(file):
                faults.append(Fault(place, f"is a pipe or a device, and no file: {file}"))
            else:
                hint = similar(Path(file))
                faults.append(Fault(place, f"there is no such file: {file}{hint}"))
        elif place[0] == "contact":
            # Before anything reads the file, also for its digest.
            with contextlib.suppress(OSError):
                try:
                    check_size(Path(file))
                except InputError as error:
                    faults.append(Fault(place, str(error)))
        data = _replaced(data, place, file)
    return data, faults[:MOST_FAULTS]


def _places(data: dict[str, Any]) -> Iterator[Place]:
    """The places of all names of files."""
    if isinstance(_at(data, ("mesh", "file")), str):
        yield "mesh", "file"
    tables = data.get("tables")
    for name in tables if isinstance(tables, dict) else ():
        if isinstance(_at(data, ("tables", name, "file")), str):
            yield "tables", name, "file"
    contact = data.get("contact")
    starts: list[Place] = [("contact",)]
    if isinstance(contact, list | tuple):
        starts = [("contact", index) for index in range(len(contact))]
    for start in starts:
        for shape in _SHAPES:
            place = (*start, "foundation", shape)
            for end in ((), ("file",)):
                if isinstance(_at(data, (*place, *end)), str):
                    yield (*place, *end)


def _at(data: Any, place: Place) -> Any:
    """The value at a place, None if there is none."""
    for part in place:
        listed = isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)
        if not listed and not (isinstance(data, dict) and part in data):
            return None
        data = data[part]
    return data


def _replaced(data: Any, place: Place, value: Any) -> Any:
    """A copy of the data with another value at a place that exists."""
    if not place:
        return value
    first, *rest = place
    if isinstance(data, dict):
        return data | {first: _replaced(data[first], tuple(rest), value)}
    copy = list(data)
    copy[int(first)] = _replaced(copy[int(first)], tuple(rest), value)
    return copy
