"""The picture of a solution: the body on its foundation, and what happens along Gamma_C."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from contact_locking.plotting.snapshot import Snapshot
    from contact_locking.solution import Solution


def picture(solution: Solution, path: Path) -> str | None:
    """Draw ``solution`` into a PNG file; collective, drawn on rank 0.

    Returns None, or on all ranks in words why there is no picture: drawing never raises.
    """
    # The styles in this package are used without DOLFINx too.
    from contact_locking.plotting.snapshot import gather

    snapshot = gather(solution)
    problem = None if snapshot is None else _draw(snapshot, path)
    return solution.domain.comm.bcast(problem, root=0)


def _draw(snapshot: Snapshot, path: Path) -> str | None:
    if not np.isfinite(snapshot.displacement).all():
        return "the displacement is not finite"
    try:
        from contact_locking.plotting.draw import draw

        draw(snapshot, path)
    except ImportError as error:
        return f"Matplotlib cannot be imported ({error})"
    except Exception as error:
        # A solve of hours must not be lost to its picture, whatever the reason.
        path.unlink(missing_ok=True)
        return f"{type(error).__name__}: {error}"
    return None
