"""The sweep: random problems of many families, solved by worker processes, judged and counted.

    make sweep                                        20 seeds of each family
    make sweep SEEDS=100 FAMILIES="rollers disc" JOBS=1
    make sweep LINEAR=iterative                       with multigrid in place of a factorisation
    make sweep N=1e4                                  with this penalty in place of the usual
    make sweep SEEDS=168 FAMILIES=pairs               all pairs of features
    make punches                                      bodies with edges, by nodes against segments
    make derivatives                                  of each problem, beside differences of solves

Of what is not right, each problem is left in the folder of the results as a study file that
`contact-locking run` takes, with the reason at its head.  The exit code is 1 if there is any.
"""

from __future__ import annotations

import argparse
import io
import multiprocessing
import os
import signal
import statistics
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, NamedTuple

from contact_locking.files import write_text
from sweep.by_segments import PUNCHES
from sweep.derivatives import RIGHT
from sweep.solve import (
    BROKEN,
    CLAIM,
    INFEASIBLE,
    NOT_SOLVED,
    REFUSED,
    SOLVED,
    WEDGED,
    WRONG,
    Outcome,
    outcome_of,
)

KINDS = (SOLVED, INFEASIBLE, REFUSED, WEDGED, CLAIM, NOT_SOLVED, WRONG, BROKEN)
# More tangents than these are many.
_MANY = 50


class Task(NamedTuple):
    """A problem to solve; ``checks`` are the further ones."""

    family: str
    seed: int
    checks: bool
    linear: str = "auto"
    n: float | None = None
    derivatives: bool | None = None


def solved(task: Task, limit: float) -> Outcome:
    """The outcome of a task, which is broken after ``limit`` seconds of the processor."""

    def stop(*_: Any) -> None:
        raise TimeoutError(f"no answer after {limit:g} s")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        return outcome_of(*task)
    except TimeoutError as error:
        return Outcome(task.family, task.seed, BROKEN, str(error))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def sweep(tasks: Sequence[Task], jobs: int, limit: float) -> Iterator[Outcome]:
    """The outcomes as they come."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        for outcome in as_completed([pool.submit(solved, task, limit) for task in tasks]):
            yield outcome.result()


def table(outcomes: Sequence[Outcome]) -> str:
    """Counts, tangents and seconds by family, and the shares of all."""
    head = f"{'family':<22}{'n':>5}" + "".join(f"{kind:>12}" for kind in KINDS)
    lines = [f"{head}{'tangents':>12}{'most':>6}{'seconds':>9}"]
    names = list(dict.fromkeys(outcome.family for outcome in outcomes))
    for name in [*names, ""]:
        rows = [outcome for outcome in outcomes if name in ("", outcome.family)]
        counts = [sum(outcome.kind == kind for outcome in rows) for kind in KINDS]
        tangents = [o.tangents for o in rows if o.kind in (SOLVED, INFEASIBLE)] or [0]
        seconds = sum(outcome.seconds for outcome in rows)
        line = f"{name or 'all':<22}{len(rows):>5}"
        line += "".join(f"{count or '.':>12}" for count in counts)
        middle = statistics.median(tangents)
        lines.append(f"{line}{middle:>12g}{max(tangents):>6}{seconds:>9.1f}")
    good = sum(outcome.is_good for outcome in outcomes)
    lines.append(f"right: {good} of {len(outcomes)}, {100.0 * good / max(len(outcomes), 1):.2f} %")
    wedged = sum(outcome.kind == WEDGED for outcome in outcomes)
    lines.append(f"of these wedged, told to have no equilibrium that is known: {wedged}")
    return "\n".join(lines)


def of_pairs(outcomes: Sequence[Outcome]) -> str:
    """The shares by which the family of pairs is measured; "" without its problems."""
    rows = [outcome for outcome in outcomes if outcome.row]
    if not rows:
        return ""
    counts = {
        "right": sum(o.kind == SOLVED for o in rows),
        "claims": sum(o.kind == CLAIM for o in rows),
        "refused": sum(o.kind == REFUSED for o in rows),
        "unsolved": sum(o.kind in (NOT_SOLVED, BROKEN) for o in rows),
        "wrong": sum(o.kind == WRONG for o in rows),
        f"above {_MANY} tangents": sum(o.tangents > _MANY for o in rows),
    }
    shares = (f"{name} {100.0 * n / len(rows):.1f} % ({n})" for name, n in counts.items())
    return f"pairs: {', '.join(shares)}"


def of_punches(outcomes: Sequence[Outcome]) -> str:
    """How many punches are right by the error of the mesh, or with halved facets alone."""
    rows = [outcome.notes for outcome in outcomes if outcome.family == PUNCHES]
    counts = (f"{sum(row[name] for row in rows)} {name}" for name in ("by mesh", "halved"))
    return f"punches: {', '.join(counts)}" if rows else ""


def of_derivatives(outcomes: Sequence[Outcome]) -> str:
    """How many derivatives are right, and the worst of those that nothing marks; "" without any."""
    rows = [row for outcome in outcomes for row in outcome.notes.get("derivatives", [])]
    if not rows:
        return ""
    right = sum(error <= RIGHT for error, _ in rows)
    worst = max((error for error, marked in rows if not marked), default=0.0)
    share = f"{100.0 * right / len(rows):.1f} % within {RIGHT:g}"
    return f"derivatives: {len(rows)}, {share}, the worst that nothing marks {worst:.1e}"


def keep(outcome: Outcome, folder: Path) -> None:
    """Leave a study file of a problem that is not right, with the reason."""
    from ruamel.yaml import YAML

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{outcome.family}_{outcome.seed}.yml"
    file = io.StringIO()
    for line in [f"{outcome.kind}:", *outcome.reason.strip().splitlines()]:
        file.write(f"# {line}\n")
    YAML().dump(outcome.study, file)
    write_text(path, file.getvalue())


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=20, help="problems of each family")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--families", nargs="*", default=[], help="all unless given")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument(
        "--check-every", type=int, default=20, help="so many problems for one with further checks"
    )
    parser.add_argument("--linear", default="auto", help="the linear solver")
    parser.add_argument("--n", type=float, help="the penalty, in place of the families' own")
    parser.add_argument("--limit", type=float, default=60.0, help="processor seconds for a problem")
    parser.add_argument("--output", type=Path, default=Path("results/sweep"))
    parser.add_argument("--derivatives", action="store_true", help="of each problem")
    given = parser.parse_args(arguments)
    from sweep.families import FAMILIES, PAIRS

    known = [*FAMILIES, PAIRS, PUNCHES]
    if unknown := [name for name in given.families if name not in known]:
        parser.error(f"no family {', '.join(unknown)}; there are: {', '.join(known)}")
    names = given.families or list(FAMILIES)
    tasks = [
        Task(
            name,
            seed,
            (seed + 7 * place) % given.check_every == 0,
            given.linear,
            given.n,
            given.derivatives or None,
        )
        for seed in range(given.first, given.first + given.seeds)
        for place, name in enumerate(names)
    ]
    outcomes = []
    for outcome in sweep(tasks, given.jobs, given.limit):
        outcomes.append(outcome)
        if outcome.row:
            told = f"{outcome.kind}, {outcome.tangents} tangents, {outcome.seconds:.1f} s"
            print(f"pairs {outcome.seed}: {told}: {outcome.row}", flush=True)
        if not outcome.is_good or (outcome.row and outcome.kind != SOLVED):
            keep(outcome, given.output)
            reason = outcome.reason.strip().splitlines()[-1:] or [""]
            print(f"{outcome.family} {outcome.seed}: {outcome.kind}: {reason[0][:150]}")
        elif sys.stderr.isatty():
            print(f"\r{len(outcomes)} of {len(tasks)}", end="\r", file=sys.stderr)
    outcomes.sort(key=lambda o: (names.index(o.family), o.seed))
    texts = [part(outcomes) for part in (table, of_pairs, of_punches, of_derivatives)]
    text = "\n".join(filter(None, texts))
    print(text)
    given.output.mkdir(parents=True, exist_ok=True)
    (given.output / "table.txt").write_text(text + "\n", encoding="utf-8")
    return 0 if all(outcome.is_good for outcome in outcomes) else 1


if __name__ == "__main__":
    # The workers are single threads.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
