"""The sweep: random problems of many families, solved by worker processes, judged and counted.

    make sweep                                        20 seeds of each family
    make sweep SEEDS=100 FAMILIES="rollers disc" JOBS=1
    make sweep LINEAR=iterative                       with multigrid in place of a factorisation
    make sweep N=1e4                                  with this penalty in place of the usual
    make sweep SEEDS=168 FAMILIES=pairs               all pairs of features

Of what is not right, each problem is left in the folder of the results as a study file that
`contact-locking run` takes, with the reason at its head.  The exit code is 1 if there is any.
"""

from __future__ import annotations

import argparse
import io
import math
import multiprocessing
import os
import resource
import signal
import statistics
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from contact_locking.files.atomic import write_text
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
)


class Task(NamedTuple):
    """A problem to solve; ``checks`` are the further ones."""

    family: str
    seed: int
    checks: bool
    linear: str = "auto"
    n: float | None = None


KINDS = (SOLVED, INFEASIBLE, REFUSED, WEDGED, CLAIM, NOT_SOLVED, WRONG, BROKEN)
# More tangents than these are many.
_MANY = 50
# A process that waits for something takes no time of the processor: so many times the limit of that
# it may take by the clock.
_WAIT = 20


class Worker:
    """A process that solves many problems; one that hangs or dies is replaced."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self._context = multiprocessing.get_context("spawn")
        self._start()

    def _start(self) -> None:
        self._connection, other = self._context.Pipe()
        self._process = self._context.Process(target=_work, args=(other,), daemon=True)
        self._process.start()
        other.close()

    def solve(self, task: Task) -> Outcome:
        """The outcome of a task, also where the process does not live to tell it."""
        start = time.perf_counter()
        reason = f"no answer after {self.limit:g} s"
        try:
            self._connection.send((task, self.limit))
            if self._connection.poll(_WAIT * self.limit):
                outcome: Outcome = self._connection.recv()
                return outcome
        except (EOFError, OSError):
            self._process.join(5.0)
            if self._process.exitcode != -signal.SIGXCPU:
                reason = f"the process died with {self._process.exitcode}"
        self.stop()
        self._start()
        seconds = time.perf_counter() - start
        study = _study(task)
        return Outcome(task.family, task.seed, BROKEN, reason, seconds=seconds, study=study)

    def stop(self) -> None:
        self._connection.close()
        self._process.kill()
        self._process.join()


def _study(task: Task) -> dict[str, Any]:
    from sweep.families import case_of

    return case_of(task.family, task.seed, task.linear, task.n).study


def _work(connection: Connection) -> None:
    """Solve what is asked for; a problem that takes more seconds than its limit ends the process.

    They are seconds of the processor, so that other work on the machine makes no difference.
    """
    from sweep.solve import outcome_of

    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    while True:
        try:
            task, limit = connection.recv()
        except EOFError:
            return
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + limit), hard))
        connection.send(outcome_of(*task))


def sweep(tasks: Sequence[Task], jobs: int, limit: float) -> Iterator[Outcome]:
    """The outcomes as they come."""
    todo = iter(tasks)
    lock, ready = threading.Lock(), threading.Condition()
    done: list[Outcome] = []
    working = jobs

    def drive() -> None:
        nonlocal working
        worker = Worker(limit)
        try:
            while True:
                with lock:
                    task = next(todo, None)
                if task is None:
                    break
                outcome = worker.solve(task)
                with ready:
                    done.append(outcome)
                    ready.notify()
        finally:
            worker.stop()
            with ready:
                working -= 1
                ready.notify()

    threads = [threading.Thread(target=drive, daemon=True) for _ in range(jobs)]
    for thread in threads:
        thread.start()
    while True:
        with ready:
            while not done and working:
                ready.wait()
            if not done:
                return
            found, done[:] = done[:], []
        yield from found


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
    given = parser.parse_args(arguments)
    from sweep.families import FAMILIES, PAIRS

    known = [*FAMILIES, PAIRS]
    if unknown := [name for name in given.families if name not in known]:
        parser.error(f"no family {', '.join(unknown)}; there are: {', '.join(known)}")
    names = given.families or list(FAMILIES)
    tasks = [
        Task(name, seed, (seed + 7 * place) % given.check_every == 0, given.linear, given.n)
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
    text = "\n".join(filter(None, (table(outcomes), of_pairs(outcomes))))
    print(text)
    given.output.mkdir(parents=True, exist_ok=True)
    (given.output / "table.txt").write_text(text + "\n", encoding="utf-8")
    return 0 if all(outcome.is_good for outcome in outcomes) else 1


if __name__ == "__main__":
    # The workers are single threads.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
