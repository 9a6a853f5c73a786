"""Runs a command whose results go to a disk of its own that is nearly full, or read-only.

    python3 full_disk.py SIZE FOLDER KEPT COMMAND ...

mounts a file system of SIZE (such as 64k; ro for a read-only one of what is there) on FOLDER, which
nobody else sees, starts it with a copy of KEPT if that is there, runs COMMAND, and copies what is
in FOLDER to KEPT.  The exit code is that of COMMAND, or 77 where the system does not allow it.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from pathlib import Path

NOT_ALLOWED = 77

_NEW_MOUNTS, _NEW_USER = 0x00020000, 0x10000000
_READ_ONLY, _REMOUNT, _BIND, _RECURSIVE, _PRIVATE = 1, 32, 4096, 16384, 1 << 18


def main(size: str, folder: Path, kept: Path, command: list[str]) -> int:
    try:
        _unshare()
        _mount(b"none", b"/", None, _RECURSIVE | _PRIVATE, None)
        if size == "ro":
            if kept.exists():
                shutil.copytree(kept, folder, dirs_exist_ok=True)
            place = os.fsencode(folder)
            _mount(place, place, None, _BIND, None)
            _mount(None, place, None, _REMOUNT | _BIND | _READ_ONLY, None)
        else:
            _mount(b"none", os.fsencode(folder), b"tmpfs", 0, f"size={size}".encode())
            if kept.exists():
                shutil.copytree(kept, folder, dirs_exist_ok=True)
    except OSError as error:
        print(f"no file system can be mounted here: {error}", file=sys.stderr)
        return NOT_ALLOWED
    code = subprocess.run(command).returncode
    shutil.rmtree(kept, ignore_errors=True)
    shutil.copytree(folder, kept)
    return code


def _unshare() -> None:
    """A view of the file systems of this process's own."""
    user, group, root = os.getuid(), os.getgid(), os.geteuid() == 0
    if _libc().unshare(_NEW_MOUNTS if root else _NEW_MOUNTS | _NEW_USER) != 0:
        raise OSError(ctypes.get_errno(), "unshare")
    if not root:
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1")


def _mount(
    source: bytes | None, target: bytes, kind: bytes | None, flags: int, data: bytes | None
) -> None:
    if _libc().mount(source, target, kind, ctypes.c_ulong(flags), data) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), os.fsdecode(target))


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


if __name__ == "__main__":
    size, folder, kept, *command = sys.argv[1:]
    sys.exit(main(size, Path(folder), Path(kept), command))
