"""The time of a process of many steps: docs/guides/steps.md.

    ./in-env python3 benchmarks/steps.py         the demo of cyclic slip in 200 steps, a minute
    ./in-env python3 benchmarks/steps.py 50      in as many steps

The run writes all of its results: fields, the saved states and the picture.  CPU seconds are
those of this process on one rank; the load of the machine tells how much the elapsed seconds mean.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

from contact_locking import load
from contact_locking.running.run import run

DEMO = Path(__file__).resolve().parent.parent / "demos" / "cyclic_slip.yml"


def main(count: int) -> None:
    """Run the demo in ``count`` steps and print what it took."""
    parameters = load(DEMO, [f"steps.count={count}"]).parameters
    before = os.getloadavg()[0]
    began, spent = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        last, warnings = run(parameters, folder)
    elapsed, spent = time.perf_counter() - began, time.process_time() - spent
    after = os.getloadavg()[0]
    assert last.converged, last.summary["reason"]
    totals = last.summary["steps"]
    print(
        f"{totals['solved']} steps with {totals['tangents'] / totals['solved']:.1f} tangents each: "
        f"{elapsed:.0f} s elapsed, {spent:.0f} s of CPU; "
        f"load {before:.1f} before, {after:.1f} after"
    )
    for warning in warnings:
        print(warning)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
