"""Studies: many cases from one file, each solved by a `run` of its own and found again by a hash.

Nothing here imports DOLFINx or MPI: the cases do, in their own processes.
"""

from .executor import Plan
from .runner import Study, run, summary_rows

__all__ = ["Plan", "Study", "run", "summary_rows"]
