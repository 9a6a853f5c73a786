"""DOLFINx's cache of compiled forms, after a process was killed while it compiled one.

FFCx marks a form that is being compiled by its C file, and one that is ready by a file
``.c.cached``.  Other processes wait for the second and give up after some time: also for a
process that is no more, in every later run.
"""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

_POLL_SECONDS = 0.1


def clear_unfinished() -> None:
    """`clear` for the cache and the patience of DOLFINx; on rank 0, which compiles for all."""
    from dolfinx import jit

    options = jit.get_options()
    clear(Path(options["cache_dir"]), float(options["timeout"]))


def clear(cache: Path, patience: float) -> None:
    """Remove the forms on which nobody can be at work: begun more than ``patience`` seconds ago.

    Waits for younger ones until they are ready or old enough.
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
    # Perhaps another process was faster; a cache that cannot be written to is none of ours.
    with contextlib.suppress(OSError):
        path.unlink()
