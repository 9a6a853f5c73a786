"""Small files that are whole whenever they are there."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

_PREFIX = ".writing-"


def write_text(path: Path, text: str) -> None:
    """Replace a file in one step. Raises OSError; then the old one is still there."""
    handle, name = tempfile.mkstemp(prefix=_PREFIX, dir=path.parent)
    try:
        with open(handle, "w", encoding="utf-8", newline="") as stream:
            stream.write(text)
        # mkstemp lets the owner alone read it; others may as far as they may read new files.
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


def remove_partial(folder: Path) -> None:
    """Remove what `write_text` left behind when it was killed. Raises OSError."""
    for path in folder.glob(f"{_PREFIX}*"):
        path.unlink()


def read_mapping(path: Path) -> dict[str, Any] | None:
    """A mapping from a JSON file; None if there is no such file or it holds anything else."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _umask() -> int:
    mask = os.umask(0o022)
    os.umask(mask)
    return mask
