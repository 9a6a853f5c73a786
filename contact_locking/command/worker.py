"""``python3 -m contact_locking.command.worker``: solves one case of a study after the other.

Each line of standard input is a JSON list: the log of a case, and the words of its command.  For
each line the worker writes the exit code of the command in a line of its standard output.  What the
command prints goes to the log.  A worker that stays starts Python, MPI, PETSc and DOLFINx once.
"""

from __future__ import annotations

import json
import os
import sys

from contact_locking.command import cli
from contact_locking.running.studies import signals


def main() -> int:
    """Work until standard input ends; a case that ends the process ends the worker."""
    answers = os.dup(1)
    nowhere = os.open(os.devnull, os.O_RDWR)
    orders = os.fdopen(os.dup(0), encoding="utf-8")
    # No case reads the orders.
    os.dup2(nowhere, 0)
    with signals.stoppable():
        for order in orders:
            log, *words = json.loads(order)
            file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
            for stream in (1, 2):
                os.dup2(file, stream)
            os.close(file)
            code = cli.main(words)
            sys.stdout.flush()
            sys.stderr.flush()
            for stream in (1, 2):
                os.dup2(nowhere, stream)
            os.write(answers, f"{code}\n".encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
