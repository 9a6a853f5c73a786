"""The entry point of ``contact-locking``: every error becomes one message and an exit code.

Exit codes: 0 converged, 1 an unexpected error, 2 bad input, 3 not converged, 128 + N where signal
N ended the command, such as 130 after Ctrl-C.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import os
import sys
from collections.abc import Sequence

from contact_locking.command import commands, terminal
from contact_locking.command.arguments import parse
from contact_locking.errors import ContactLockingError, interrupt_behind
from contact_locking.running.studies import signals

UNEXPECTED = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; no exception leaves it.

    ``argv`` are the words after the program's name, those it was started with by default.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    arguments = argparse.Namespace()
    try:
        arguments = parse(words)
        code = _run_command(arguments, program=argv is None)
    except ContactLockingError as error:
        # All ranks have raised it.
        terminal.complain(f"error: {error}")
        code = error.exit_code
    except SystemExit as stop:  # argparse, after --help and --version
        code = int(stop.code or 0)
    except KeyboardInterrupt as interrupt:
        return _interrupted(interrupt, arguments)
    except BrokenPipeError:
        # Nobody reads the output any more; let the interpreter flush it to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNEXPECTED
    except Exception as error:
        behind = interrupt_behind(error)
        if isinstance(behind, KeyboardInterrupt):
            return _interrupted(behind, arguments)
        text, hint = _unexpected(error)
        if "--debug" in words:
            return terminal.abort(UNEXPECTED, text, error)
        return terminal.abort(UNEXPECTED, f"{text}\n{hint}")
    terminal.leave_together()
    return code


def _run_command(arguments: argparse.Namespace, program: bool = False) -> int:
    """Run a command; ``program`` says that the process was started for it alone."""
    arguments.program = program
    end_ranks = functools.partial(_end_ranks, arguments)
    with signals.stoppable(end_ranks) if program else contextlib.nullcontext():
        code = commands.COMMANDS[arguments.command](arguments)
    sys.stdout.flush()
    return code


def _interrupted(interrupt: KeyboardInterrupt, arguments: argparse.Namespace) -> int:
    """Say that the command was interrupted, and what there is of its results."""
    said = str(interrupt) or "interrupted"
    if left := getattr(arguments, "left", lambda: "")():
        said += f"\n{left}"
    return terminal.abort(signals.exit_code(interrupt), said)


def _end_ranks(arguments: argparse.Namespace, interrupt: KeyboardInterrupt) -> None:
    """End all ranks if there are several.

    A rank that cleaned up, or went on, would meet the other ranks in the wrong place: they would
    wait for each other without end, or add up numbers that do not belong together.
    """
    if terminal.world() is not None:
        _interrupted(interrupt, arguments)


def _unexpected(error: Exception) -> tuple[str, str]:
    """One line about the error, and another about the remedy."""
    if isinstance(error, OSError) and error.strerror:
        place = error.filename or "a file of its own, perhaps in the cache of compiled forms"
        hint = (
            "The system refuses it, as with a full disk or a home that is read-only; "
            "XDG_CACHE_HOME says where compiled forms are kept."
        )
        return f"error: {error.strerror}: {place}", hint
    text = " ".join(f"error: unexpected {type(error).__name__}: {error}".split())
    return (
        text,
        "This is a defect; please report it with the study file and the output of --debug.",
    )
