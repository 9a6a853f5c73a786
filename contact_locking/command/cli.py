"""The entry point of ``contact-locking``: every error becomes one message and an exit code.

Exit codes: 0 converged, 1 an unexpected error, 2 bad input, 3 not converged, 128 + N where signal
N ended the command, such as 130 after Ctrl-C.
"""

from __future__ import annotations

import contextlib
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
    try:
        code = _run_command(words, program=argv is None)
    except ContactLockingError as error:
        # All ranks have raised it.
        terminal.complain(f"error: {error}")
        code = error.exit_code
    except SystemExit as stop:  # argparse, after --help and --version
        code = int(stop.code or 0)
    except KeyboardInterrupt as interrupt:
        return _interrupted(interrupt)
    except BrokenPipeError:
        # Nobody reads the output any more; let the interpreter flush it to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNEXPECTED
    except Exception as error:
        behind = interrupt_behind(error)
        if isinstance(behind, KeyboardInterrupt):
            return _interrupted(behind)
        text, hint = _unexpected(error)
        if "--debug" in words:
            return terminal.abort(UNEXPECTED, text, error)
        return terminal.abort(UNEXPECTED, f"{text}\n{hint}")
    terminal.leave_together()
    return code


def _run_command(words: list[str], program: bool = False) -> int:
    """Run a command; ``program`` says that the process was started for it alone."""
    arguments = parse(words)
    arguments.program = program
    with signals.stoppable(_end_ranks) if program else contextlib.nullcontext():
        code = commands.COMMANDS[arguments.command](arguments)
    sys.stdout.flush()
    return code


def _interrupted(interrupt: KeyboardInterrupt) -> int:
    return terminal.abort(signals.exit_code(interrupt), str(interrupt) or "interrupted")


def _end_ranks(interrupt: KeyboardInterrupt) -> None:
    """End all ranks if there are several.

    A rank that cleaned up, or went on, would meet the other ranks in the wrong place: they would
    wait for each other without end, or add up numbers that do not belong together.
    """
    if terminal.world() is not None:
        _interrupted(interrupt)


def _unexpected(error: Exception) -> tuple[str, str]:
    """In one line what went wrong, and in another what to do."""
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
