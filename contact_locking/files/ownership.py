"""The files that this program has written to a folder: it replaces and removes no others.

The list of a folder is a file in it, with the size and a digest of each file, so that a file which
the user has put in place of one of these is the user's.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from contact_locking.errors import InputError
from contact_locking.files import atomic

#: The list of the files.
LIST = "contact-locking-files.json"
_PROGRAM = "contact_locking"
# The digest of more would take as long as writing large fields.
_DIGESTED_BYTES = 1 << 20

# The looks of a file that are this program's; None for any, of a file that changes while it runs.
_Looks = list[str] | None


def require_own(directory: Path, names: Iterable[str], key: str | None = None) -> None:
    """Raise InputError if one of the names is in a folder and not this program's; OSError.

    A folder is this program's if all files in it are.
    """
    listed = _listed(directory, key)
    for name in names:
        for path in _files_of(directory / name):
            if not _is_own(path, directory, listed):
                raise InputError(
                    f"{path}: was not written by an earlier run, or has been changed since, and "
                    "would be replaced or removed; move it away, or write to another folder",
                    key,
                )


def replace(directory: Path, made: Path, names: Iterable[str], key: str | None = None) -> None:
    """Move files and folders from the staging folder ``made`` to ``directory``, in their order.

    They replace those of the same names, and a name that is not in ``made`` is removed from
    ``directory``.  Raises InputError, before anything is moved, as `require_own`, and OSError.
    """
    names = tuple(names)
    require_own(directory, names, key)
    # The list has the new files before they are in place: a killed run leaves no strangers.
    new = [path for name in names for path in _files_of(made / name)]
    _add(directory, {path.relative_to(made).as_posix(): [_look_of(path)] for path in new})
    for name in names:
        atomic.put_in_place(made / name, directory / name)


def discard(directory: Path) -> None:
    """Remove the files of a list, and the folder unless it holds others.  Raises OSError."""
    listed = _listed(directory, None)
    for path in [directory / name for name in listed]:
        if _is_own(path, directory, listed):
            path.unlink()
    if listed:
        (directory / LIST).unlink()
    for folder, *_ in os.walk(directory, topdown=False):
        with contextlib.suppress(OSError):  # it holds others
            os.rmdir(folder)


def write_text(path: Path, text: str) -> None:
    """Replace a text file of this program.  Raises InputError as `require_own`, and OSError."""
    with atomic.staging(path.parent) as made:
        (made / path.name).write_text(text, encoding="utf-8", newline="")
        replace(path.parent, made, [path.name])


def claim(directory: Path, names: Iterable[str]) -> None:
    """List files that change while the program runs.  Raises as `require_own`, and OSError."""
    names = tuple(names)
    require_own(directory, names)
    _add(directory, dict.fromkeys(names))


def is_own(path: Path) -> bool:
    """Whether there is such a file or folder, and all of it is this program's.  Raises OSError."""
    listed = _listed(path.parent, None)
    return os.path.lexists(path) and all(
        _is_own(file, path.parent, listed) for file in _files_of(path)
    )


def _is_own(path: Path, directory: Path, listed: Mapping[str, _Looks]) -> bool:
    name = path.relative_to(directory).as_posix()
    if name not in listed or path.is_symlink() or not path.is_file():
        return False
    looks = listed[name]
    return looks is None or _look_of(path) in looks


def _files_of(path: Path) -> Iterator[Path]:
    """The path itself, or all that a folder holds but for folders."""
    is_folder = path.is_dir() and not path.is_symlink()
    for entry in path.rglob("*") if is_folder else [path]:
        if entry.is_symlink() or (entry.exists() and not entry.is_dir()):
            yield entry


def _look_of(path: Path) -> str:
    with path.open("rb") as stream:
        digest = hashlib.sha256(stream.read(_DIGESTED_BYTES)).hexdigest()
    return f"{path.stat().st_size} {digest[:16]}"


def _add(directory: Path, new: Mapping[str, _Looks]) -> None:
    old = {
        name: looks
        for name, looks in _listed(directory, None).items()
        if looks is None or (directory / name).exists()
    }
    for name, looks in new.items():
        before = old.get(name, [])
        # Until the new file is in place, the old one is there.
        old[name] = None if looks is None or before is None else [*before[-1:], *looks]
    content = {"program": _PROGRAM, "files": dict(sorted(old.items()))}
    atomic.write_text(directory / LIST, json.dumps(content, indent=1) + "\n")


def _listed(directory: Path, key: str | None) -> dict[str, _Looks]:
    path = directory / LIST
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
        files: dict[str, _Looks] = dict(content["files"])
        # The list may have come with the folder from elsewhere.
        inside = all(".." not in Path(n).parts and not Path(n).is_absolute() for n in files)
        if content["program"] == _PROGRAM and inside:
            return files
    except FileNotFoundError:
        return {}
    except (ValueError, KeyError, TypeError, RecursionError):
        pass
    raise InputError(f"{path}: is not the list that this program writes; move it away", key)
