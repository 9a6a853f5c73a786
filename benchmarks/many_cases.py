"""What a study of many small cases takes per case, beyond the solves.

    ./in-env python3 benchmarks/many_cases.py
    ./in-env python3 benchmarks/many_cases.py --cases 20 --jobs 2

The cases are blocks of 2178 unknowns with their fields and pictures.  "Beyond the solve" is the
time of the study less the ``wall_seconds`` of its cases, which contain mesh, forms, solve and
certificate.  Other work on the machine makes both times longer, so that the time by the clock is
that of an idle machine only; the CPU time is less disturbed.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STUDY = """\
mesh: {{builder: block, h: 0.0322580645, structured: true}}
material: {{elasticity: {{young: 1.0, poisson: 0.3}}, locking_limit: 0.02}}
loads:
  displacements: [{{on: left, value: [0, 0]}}]
  tractions: [{{on: top, value: [0, -0.08*(1 - x)]}}, {{on: right, value: [0, 0.007]}}]
friction: {{smoothing: {{radius: 0.1}}}}
study:
  vary:
    friction.coefficient: {{linear: [0.1, 0.4, {rows}]}}
    penalty.n: {{geometric: [1.0e2, 1.0e6, 4]}}
output: {{directory: results, fields: {files}, picture: {files}}}
"""
COMMAND = (sys.executable, "-m", "contact_locking", "study", "study.yml", "--jobs")


def measure(cases: int, jobs: int, files: bool) -> str:
    """A row of the table: the seconds per case."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        text = STUDY.format(rows=max(2, cases // 4), files=str(files).lower())
        (folder / "study.yml").write_text(text, encoding="utf-8")
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run([*COMMAND, str(jobs)], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        wall = time.perf_counter() - began
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        lines = (folder / "results" / "table.jsonl").read_text(encoding="utf-8").splitlines()
    rows = [json.loads(line) for line in lines]
    count, solves = len(rows), sum(row["wall_seconds"] for row in rows)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    share = 1.0 - solves / (jobs * wall)
    return (
        f"| {count} | {jobs} | {'yes' if files else 'no'} | {wall / count:.2f} | "
        f"{solves / count:.2f} | {(jobs * wall - solves) / count:.2f} | {cpu / count:.2f} | "
        f"{cpu * share / count:.2f} |"
    )


def main() -> None:
    """Print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=200, help="a multiple of 4, from 8")
    parser.add_argument("--jobs", type=int, default=1, help="cases at a time")
    given = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start; seconds per case\n")
    print("| cases | at a time | fields and picture | study | solve | beyond | CPU | CPU beyond |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for files in (True, False):
        print(measure(given.cases, given.jobs, files), flush=True)


if __name__ == "__main__":
    main()
