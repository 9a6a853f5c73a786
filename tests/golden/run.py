"""Solve the golden problems and compare, or write their numbers anew.

    make golden                          minutes: a table of what differs, and the exit code 1
    make golden ONLY="demos/ sweep/disc"     those whose names begin so
    make golden-write ONLY=demos/block       write the numbers of these, or without ONLY of all

Numbers are written by a deliberate call only, after a change that is meant to change them.  Each
problem is then solved a second time with moduli that are larger by a billionth, and what this
changes beyond the tolerance is left out, as rounding decides it.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any

from contact_locking.files import write_text
from golden.numbers import NUMBERS, PROBLEMS, Data, determined, differences, numbers_of, read


def solved(problems: Data, golden: Data, jobs: int, again: bool) -> Iterator[tuple[str, Data]]:
    """The numbers of problems as they come, the longest first."""
    context = multiprocessing.get_context("spawn")

    def seconds(name: str) -> float:
        return float(golden.get(name, {}).get("seconds", 0.0))

    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        tasks = {
            pool.submit(_task, problems[name], seconds(name), again): name
            for name in sorted(problems, key=seconds, reverse=True)
        }
        for task in as_completed(tasks):
            yield tasks[task], task.result()


def _task(problem: Data, seconds: float, again: bool) -> Data:
    numbers = numbers_of(problem, seconds)
    return determined(numbers, numbers_of(problem, seconds, stiffer=True)) if again else numbers


def write(numbers: Data) -> None:
    """numbers.json, a line for each problem."""
    lines = [f"{json.dumps(name)}: {json.dumps(numbers[name])}" for name in sorted(numbers)]
    write_text(NUMBERS, "{\n" + ",\n".join(lines) + "\n}\n")


def table(rows: Sequence[tuple[str, str, Any, Any]]) -> str:
    cells = [("problem", "quantity", "golden", "now"), *rows]
    texts = [[str(cell) for cell in row] for row in cells]
    widths = [min(max(map(len, column)), 60) for column in zip(*texts, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in texts)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--only", nargs="*", default=[], help="the beginnings of names")
    parser.add_argument("--write", action="store_true", help="write the numbers anew")
    options = parser.parse_args(arguments)
    problems, golden = read(PROBLEMS), read(NUMBERS)
    beginnings = tuple(options.only) or ("",)
    chosen = {name: problems[name] for name in problems if name.startswith(beginnings)}
    began, rows = time.perf_counter(), list[tuple[str, str, Any, Any]]()
    written = {name: numbers for name, numbers in golden.items() if name in problems}
    for name, numbers in solved(chosen, golden, options.jobs, options.write):
        if options.write and not numbers:
            print(f"{name}: rounding decides what comes out: take it out of {PROBLEMS.name}")
        elif options.write:
            written[name] = numbers
        elif name not in golden:
            rows.append((name, "all", None, "not written yet"))
        else:
            rows += [(name, *row) for row in differences(golden[name], numbers)]
    if options.write:
        write(written)
    if rows:
        print(table(sorted(rows)))
    unlike = len({name for name, *_ in rows})
    minutes = (time.perf_counter() - began) / 60.0
    print(f"{len(chosen)} problems, {unlike} of them differ, {minutes:.1f} minutes")
    return 1 if rows else 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
