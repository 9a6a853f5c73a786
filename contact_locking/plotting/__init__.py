"""The picture of a solution: the body on its foundation, and the tractions on Gamma_C."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from contact_locking.errors import NoRendering, NoRoom, is_full
from contact_locking.results.names import PICTURE, SNAPSHOT

if TYPE_CHECKING:
    from contact_locking.plotting.snapshot import Snapshot
    from contact_locking.plotting.views import Image
    from contact_locking.results.solution import StudySolution


def picture(solution: StudySolution, folder: Path) -> str | None:
    """Draw ``solution`` into a PNG file in ``folder``, and save its snapshot; collective.

    Returns None, or on all ranks the reason why there is no picture or only a plainer one.
    Raises NoRoom on all ranks if the disk is full, and no other error.
    """
    # The other modules of this package must work without DOLFINx.
    from contact_locking.plotting.gather import gather

    snapshot = gather(solution)
    outcome: str | NoRoom | None = None
    if snapshot is not None:
        try:
            outcome = _draw(snapshot, folder)
        except NoRoom as error:
            outcome = error
    outcome = solution.domain.comm.bcast(outcome, root=0)
    if isinstance(outcome, NoRoom):
        raise outcome
    return outcome


def _draw(snapshot: Snapshot, folder: Path) -> str | None:
    if not np.isfinite(snapshot.displacement).all():
        return "no picture was drawn: the displacement is not finite"
    target = folder / PICTURE
    try:
        from contact_locking.plotting.snapshot_file import save

        save(snapshot, folder / SNAPSHOT)
        images, problem = None, None
        if snapshot.dim == 3:
            images, problem = _views(folder / SNAPSHOT)
        from contact_locking.plotting.draw import draw

        draw(snapshot, target, images)
    except ImportError as error:
        return f"no picture was drawn: Matplotlib cannot be imported ({error})"
    except Exception as error:
        # An error of the picture must not lose the results of a long solve.
        target.unlink(missing_ok=True)
        if isinstance(error, OSError) and is_full(error):
            raise NoRoom(f"{error.strerror} ({error.filename or target})") from error
        return f"no picture was drawn: {type(error).__name__}: {error}"
    return problem


def _views(snapshot: Path) -> tuple[dict[str, Image] | None, str | None]:
    """The views of a saved body, or None and the reason why there are none."""
    from contact_locking.plotting import offscreen

    try:
        return offscreen.views(snapshot), None
    except NoRendering as reason:
        return None, (
            f"the picture was drawn by Matplotlib alone: {reason}\n"
            f"For views by PyVista: {offscreen.INSTALL}"
        )
