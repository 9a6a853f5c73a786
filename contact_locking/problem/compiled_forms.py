"""The cache of compiled forms after a process was killed while it compiled a form.

FFCx writes the C file of a form before the compilation and the file ``.c.cached`` afterwards.  A
process that finds only the C file waits for the other file until a timeout.  After a killed process
every later run would wait in vain.
"""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

_POLL_SECONDS = 0.1


def clear_unfinished() -> None:
    """`clear` with the cache and the timeout of DOLFINx; for rank 0, which compiles for all."""
    from dolfinx import jit

    options = jit.get_options()
    clear(Path(options["cache_dir"]), float(options["timeout"]))


def clear(cache: Path, patience: float) -> None:
    """Remove the unfinished forms that are older than ``patience`` seconds.

    Waits for younger forms until they are ready or old enough.
    """
    for ready in cache.glob("libffcx_*.c.cached"):
        if not ready.with_suffix("").exists():
            _remove(ready)
    deadline = time.monotonic() + patience
    waiting = [path for path in cache.glob("libffcx_*.c") if not _ready(path)]
    while waiting and time.monotonic() < deadline:
        for path in waiting:
            if _age(path) > patience:
                _remove(path)
        waiting = [path for path in waiting if path.exists() and not _ready(path)]
        if waiting:
            time.sleep(_POLL_SECONDS)
    for path in waiting:
        _remove(path)


def _ready(path: Path) -> bool:
    return path.with_name(f"{path.name}.cached").exists()


def _age(path: Path) -> float:
    try:
        return time.time() - path.stat().st_mtime
    except OSError:
        return 0.0


def _remove(path: Path) -> None:
    # Another process may have removed the file, and a read-only cache belongs to another user.
    with contextlib.suppress(OSError):
        path.unlink()
