"""The processes that solve together, with DOLFINx and PETSc made ready."""

from __future__ import annotations

import argparse
import contextlib
import os
import pwd
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking.command import terminal
from contact_locking.errors import ContactLockingError, InputError
from contact_locking.studies import signals

if TYPE_CHECKING:
    from mpi4py import MPI

# PETSc's codes for an argument that is wrong, out of range, wrong input, of unknown type.
_OPTION_ERRORS = (62, 63, 83, 86)

# The options of DOLFINx and of FFCx, which both take from the current folder too.
_OPTION_FILES = ("dolfinx_jit_options.json", "ffcx_options.json")


def world_with_dolfinx(arguments: argparse.Namespace) -> MPI.Intracomm:
    """MPI's world, with PETSc initialised without the command line's words and petscrc files.

    Raises InputError for environment variables with which MPI would abort.
    """
    _prepare_environment()
    try:
        import petsc4py

        # PETSc's signal handlers would report a crash where a process is asked to end.
        with signals.kept(signal.SIGPIPE):
            # A petscrc file in the folder of a study may hold options that run code.  The options
            # in PETSC_OPTIONS are the user's own.
            petsc4py.init(["contact-locking", "-skip_petscrc"])
            import dolfinx.fem.petsc  # noqa: F401
            from mpi4py import MPI
    except ImportError as error:
        raise ContactLockingError(
            f"DOLFINx cannot be imported here: {error}\n"
            "It needs DOLFINx 0.9 or newer with PETSc; the README says how to get it."
        ) from error
    # If the reader of the output leaves early, as head does, a program of one process ends in
    # silence, whether Python or a monitor of PETSc was printing.
    if arguments.program and MPI.COMM_WORLD.size == 1:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        terminal.warn_of_separate_tasks()
    for name in ignore_current_folder():
        terminal.complain(
            f"warning: {name} in this folder is ignored, as options of a compiler can run code; "
            "the folder of your configuration is the place for it: ~/.config/dolfinx or ffcx"
        )
    return MPI.COMM_WORLD


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


def _prepare_environment() -> None:
    """Give MPI a home, which cron and systemd leave out, and refuse a TMPDIR that is none."""
    if not os.environ.get("HOME"):
        os.environ["HOME"] = pwd.getpwuid(os.getuid()).pw_dir
    folder = os.environ.get("TMPDIR")
    if folder and not (os.path.isdir(folder) and os.access(folder, os.W_OK)):
        raise InputError(
            f"TMPDIR: {folder} is no folder that can be written to; make it, or unset TMPDIR"
        )


@contextlib.contextmanager
def petsc_complaints() -> Iterator[None]:
    """Turn an error of PETSc about an option into InputError."""
    from petsc4py import PETSc

    try:
        yield
    except PETSc.Error as error:
        if error.ierr not in _OPTION_ERRORS:
            raise
        raise InputError(f"PETSc refuses an option: {str(error).splitlines()[-1]}") from error
