"""The cache of compiled forms, and the files from which DOLFINx takes options of the compiler.

FFCx writes the C file of a form before the compilation and the file ``.c.cached`` afterwards.  A
process that finds only the C file waits for the other file until a timeout.  After a killed process
every later run would wait in vain.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path

from contact_locking.errors import ContactLockingError

# The options of DOLFINx and of FFCx, which both take from the current folder too.
_OPTION_FILES = ("dolfinx_jit_options.json", "ffcx_options.json")
_UNREADY = re.compile(r"remove (\S+\.c)\b")

_READY = ".cached"
_POLL_SECONDS = 0.1


def ignore_current_folder() -> list[str]:
    """Let DOLFINx and FFCx take options from the user's configuration, not from this folder.

    Options of the compiler can run code, and a folder with a study may come from anybody.  Returns
    the names of the files that are ignored.  Call this function before anything is compiled.
    """
    import ffcx.options
    from dolfinx import jit

    ignored = [name for name in _OPTION_FILES if Path(name).exists()]
    # Both read their files once.
    with contextlib.chdir("/"):
        jit.get_options()
        ffcx.options.get_options()
    return ignored


@contextlib.contextmanager
def explained() -> Iterator[None]:
    """Say what to do where a form that another process began to compile is not ready in time."""
    try:
        yield
    except (TimeoutError, RuntimeError) as error:
        # On several ranks DOLFINx raises RuntimeError, with the text of the first rank there.
        if "timed out" not in str(error):
            raise
        found = _UNREADY.search(str(error))
        place = f": {found[1]}" if found else ", which the cache of compiled forms has"
        raise ContactLockingError(
            "a form that another process began to compile is not ready after the timeout of "
            "DOLFINx. Wait until that process is done; if it was killed, delete its unfinished "
            f"file and start again{place}"
        ) from error


def clear_unfinished() -> None:
    """`clear` with the cache and the timeout of DOLFINx; for rank 0, which compiles for all."""
    from dolfinx import jit

    options = jit.get_options()
    clear(Path(options["cache_dir"]), float(options["timeout"]))


def clear(cache: Path, patience: float) -> None:
    """Remove the unfinished forms that are older than ``patience`` seconds and not being compiled.

    Waits for younger forms until they are ready or old enough.
    """
    sources, ready = _forms(cache)
    for name in ready - sources:
        if not (cache / name).exists():
            _remove(_mark(cache / name))
    deadline = time.monotonic() + patience
    waiting = [cache / name for name in sources - ready if not _ready(cache / name)]
    while waiting and time.monotonic() < deadline:
        for path in waiting:
            if _age(path) > patience and not _is_being_compiled(path):
                _remove(path)
        waiting = [path for path in waiting if path.exists() and not _ready(path)]
        if waiting:
            time.sleep(_POLL_SECONDS)
    for path in waiting:
        if not _is_being_compiled(path):
            _remove(path)


def _forms(cache: Path) -> tuple[set[str], set[str]]:
    """The names of C files, and those of C files that are ready; the folder is read once."""
    try:
        names = [name for name in os.listdir(cache) if name.startswith("libffcx_")]
    except OSError:  # no form has been compiled yet
        return set(), set()
    sources = {name for name in names if name.endswith(".c")}
    return sources, {name.removesuffix(_READY) for name in names if name.endswith(f".c{_READY}")}


def _is_being_compiled(path: Path) -> bool:
    """Whether the command of a running process names the file, as that of a compiler does."""
    for command in Path("/proc").glob("[0-9]*/cmdline"):
        # The process may have ended in the meantime, or belong to another user.
        with contextlib.suppress(OSError):
            if path.name.encode() in command.read_bytes():
                return True
    return False


def _ready(path: Path) -> bool:
    return _mark(path).exists()


def _mark(path: Path) -> Path:
    """The file that FFCx writes when the form of a C file is ready."""
    return path.with_name(path.name + _READY)


def _age(path: Path) -> float:
    try:
        return time.time() - path.stat().st_mtime
    except OSError:
        return 0.0


def _remove(path: Path) -> None:
    # Another process may have removed the file, and a read-only cache belongs to another user.
    with contextlib.suppress(OSError):
        path.unlink()
