"""Stands for the program in tests of studies: writes a summary without solving anything.

What it does follows from penalty.n: 3 does not converge, 2 is bad input, 9 is killed, 5 crashes, 6
too, as PETSc tells it, 1 is a defect, 7 leaves nothing, 8 finds the disk full.
Each call leaves a line in the file FAKE_LOG; FAKE_SECONDS is how long it takes.
"""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import sys
import time
from pathlib import Path

from contact_locking import __version__


def main() -> int:
    file = Path(sys.argv[2])
    penalty = re.search(r"^  n: (\S+)", file.read_text(), re.MULTILINE)
    assert penalty is not None
    n = float(penalty[1].replace(".inf", "inf"))
    with Path(os.environ["FAKE_LOG"]).open("a") as log:
        log.write(f"{os.getpid()} {n:g}\n")
    time.sleep(float(os.environ.get("FAKE_SECONDS", "0")))
    if n == 2:
        print("error: parameters.yaml:3: contact.on: no part\n       is named so", file=sys.stderr)
        return 2
    if n in (5, 9):
        os.kill(os.getpid(), signal.SIGKILL if n == 9 else signal.SIGSEGV)
    if n == 6:
        told = "Caught signal number 11 SEGV: Segmentation Violation, probably memory access"
        print(f"[0]PETSC ERROR: {told}\nMPI_ABORT was invoked", file=sys.stderr)
        return 59
    if n == 1:
        raise ZeroDivisionError
    if n == 8:
        print(f"error: no results: {os.strerror(errno.ENOSPC)} (out)", file=sys.stderr)
        return 1
    if n == 7:
        return 0
    summary = {
        "converged": n != 3,
        "reason": "every criterion held" if n != 3 else "too steep",
        "fingerprint": file.parent.name,
        "version": __version__,
        "compliance": 1.0 / n,
        "contact_force": [0.0, n],
        "stages": [{"n": n}],
        "warnings": ["one", "two"],
        "duality_gap": None,
        "bounds": {"b": {"bound": None, "holds": True}},
        "not_finite": {"bounds.b.bound": "inf"},
    }
    partial = file.with_name("partial")
    partial.write_text(json.dumps(summary))
    partial.replace(file.with_name("summary.json"))
    return 0 if n != 3 else 3


sys.exit(main())
