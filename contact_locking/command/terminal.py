"""The texts that the command line prints, once, from rank 0."""

from __future__ import annotations

import contextlib
import os
import sys
import time
import traceback
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contact_locking.plain_text import printable

if TYPE_CHECKING:
    from mpi4py import MPI
    from rich.console import Console

# Variables by which launchers tell a process that it may be one of several.
_LAUNCHERS = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK", "MPI_LOCALNRANKS")
# Where only some ranks may have failed, rank 0 has this time to speak before the others do.
_GRACE_SECONDS = 1.0


def world() -> MPI.Intracomm | None:
    """All processes, or None for one alone; MPI is imported only if there may be others."""
    if "mpi4py.MPI" not in sys.modules and not _is_launched():
        return None
    from mpi4py import MPI

    return MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else None


def _is_launched() -> bool:
    return any(name in os.environ for name in _LAUNCHERS)


def is_root() -> bool:
    """Whether this is rank 0, or the only process."""
    comm = world()
    return comm is None or comm.rank == 0


def console() -> Console:
    """Standard output through rich; wide enough for long lines where it is no terminal.

    Under a launcher the output counts as no terminal: Open MPI gives every process a
    pseudo-terminal, whether the output ends on a terminal or in a file.
    """
    from rich.console import Console

    if not _is_launched() and sys.stdout.isatty():
        return Console(highlight=False)
    return Console(highlight=False, width=120, force_terminal=False)


def complain(text: str) -> None:
    """Print to standard error, from rank 0; lines after the first are indented."""
    if is_root():
        head, *rest = printable(text).split("\n")
        print("\n".join([head, *(f"       {line}" for line in rest)]), file=sys.stderr, flush=True)


def leave_together() -> None:
    """Wait for all ranks, as a launcher ends the others when one leaves with an error."""
    sys.stdout.flush()
    comm = world()
    if comm is not None:
        comm.Barrier()


def abort(code: int, text: str, error: BaseException | None = None) -> int:
    """Print the reason and end all ranks, of which perhaps only this one has failed.

    Returns ``code`` for a single process.  Prints the traceback of ``error`` if given.
    """
    comm = world()
    if comm is not None and comm.rank > 0:
        # If rank 0 has failed as well, it prints its reason, and its abort ends this wait.
        time.sleep(_GRACE_SECONDS)
        text = f"{text} (on rank {comm.rank})"
    # Writing to a closed terminal raises OSError.
    with contextlib.suppress(OSError):
        if error is not None:
            traceback.print_exception(error)
        print(printable(text), file=sys.stderr, flush=True)
        sys.stdout.flush()
    if comm is not None:
        comm.Abort(code)
    return code


def columns(rows: Sequence[Sequence[str]]) -> str:
    """A table without rules, each column as wide as its longest entry."""
    rows = [[printable(text, keep="") for text in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(f"{text:{width}}" for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def summary_rows(
    summary: Mapping[str, Any], ratio: float, directory: str | Path
) -> list[tuple[str, str]]:
    """The summary in a few rows; ``ratio`` is the largest |eps|/M, zero if M is infinite."""
    iterations = summary["iterations"]
    against = f" = {ratio:.4g} M" if ratio > 0.0 else "  (no locking limit)"
    restart = summary.get("restart")
    return [
        ("converged", "yes" if summary["converged"] else "no"),
        *([("restart", restart)] if restart else []),
        ("size", f"{summary['dofs']} dofs, {summary['cells']} cells, {summary['ranks']} rank(s)"),
        (
            "iterations",
            f"{iterations['tangents']} tangents, {iterations['linear']} linear, "
            f"{iterations['friction']} friction updates",
        ),
        ("residual", f"{summary['residual']:.1e}"),
        ("largest |eps|", f"{summary['strain_norm_max']:.4g}{against}"),
        ("locked share", f"{100 * summary['locked_fraction']:.1f} %"),
        ("contact force", _vector(summary["contact_force"])),
        ("friction force", _vector(summary["friction_force"])),
        (
            "contact, slip area",
            f"{summary['contact_area']:.4g}, {summary['slip_area']:.4g}",
        ),
        ("criteria", _criteria(summary["certificate"]["criteria"])),
        ("proved bounds", _bounds(summary["bounds"])),
        ("error estimates", _errors(summary["certificate"]["errors"])),
        *_guaranteed(summary["certificate"]["errors"].get("guaranteed")),
        *_limit_load(summary["certificate"].get("limit_load")),
        ("uniqueness", summary["certificate"]["constants"]["uniqueness"]["verdict"]),
        ("time", f"{summary['wall_seconds']:.1f} s"),
        ("results in", str(directory)),
    ]


def _vector(values: Iterable[float]) -> str:
    return "(" + ", ".join(f"{value + 0.0:.4g}" for value in values) + ")"


def _bounds(bounds: Mapping[str, Mapping[str, Any]]) -> str:
    broken = [name for name, entry in bounds.items() if entry["holds"] is False]
    if broken:
        return f"violated: {', '.join(broken)}"
    held = sum(entry["holds"] is True for entry in bounds.values())
    return f"{held} hold" if held else "none applies"


def _criteria(criteria: Mapping[str, Mapping[str, Any]]) -> str:
    """The criteria that fail; if all hold, the one nearest to its limit."""
    failed = [
        f"{name} {entry['value']:.1e} > {entry['limit']:g}"
        for name, entry in criteria.items()
        if not entry["holds"]
    ]
    if failed:
        return f"failed: {', '.join(failed)}"
    name, entry = max(criteria.items(), key=lambda item: item[1]["value"] / item[1]["limit"])
    share = entry["value"] / entry["limit"]
    return (
        f"{len(criteria)} hold; nearest to its limit: {name.replace('_', ' ')} ({share:.0e} of it)"
    )


def _errors(errors: Mapping[str, Mapping[str, Any]]) -> str:
    """The relative errors of mesh and penalty in the energy norm."""
    shown = []
    for key, label in (
        ("mesh", "mesh about {:.2g} %"),
        ("penalty", "penalty at most {:.2g} %"),
        ("penalty_measured", "measured {:.2g} %"),
    ):
        relative = errors.get(key, {}).get("relative")
        if relative is not None:
            shown.append(label.format(100.0 * relative))
    return ", ".join(shown) or "none applies"


def _guaranteed(entry: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    """The row of the guaranteed bound, if the study file asks for the bound."""
    if entry is None:
        return []
    if not entry["applicable"]:
        return [("guaranteed bound", entry["reason"])]
    size = entry["relative"]
    share = "nothing moves" if size is None else f"error at most {100.0 * size:.3g} %"
    return [("guaranteed bound", f"{share}, for the friction bound of this solution")]


def _limit_load(entry: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    """The row of the limit load, if the study file asks for proofs and displacements move."""
    if entry is None:
        return []
    if entry["load_factor"] is None:
        return [("limit load", entry["reason"])]
    confirmed, excluded = entry["load_factor"]
    most = "any share" if excluded is None else f"more than {100.0 * excluded:.4g} %"
    shares = f"{100.0 * confirmed:.4g} % can be followed, {most} on no mesh"
    return [("limit load", f"of the prescribed displacements {shares}")]
