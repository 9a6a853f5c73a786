"""The picture of a solution: the body on its foundation, and the tractions on Gamma_C."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from contact_locking.errors import NoRendering, NoRoom, is_full
from contact_locking.files import require_room
from contact_locking.findings import Finding
from contact_locking.results.output import PICTURE, TEXTS_BYTES

if TYPE_CHECKING:
    from contact_locking.results.solution import Solution
    from contact_locking.view.pictures.style import Snapshot, Units


def pictures(solution: Solution, folder: Path) -> list[Finding]:
    """Draw the picture of a solution; returns findings; collective."""
    problem = picture(solution, folder)
    return [Finding("output.left_out", reason=problem)] if problem else []


def picture(solution: Solution, folder: Path) -> str | None:
    """Draw ``solution`` into a PNG file in ``folder``; collective.

    In three dimensions PyVista draws the picture.  Returns None, or on all ranks the reason why
    there is no picture.  Raises NoRoom on all ranks if the disk is full, and no other error.
    """
    # The other modules of this package must work without DOLFINx.
    from contact_locking.view.pictures.gather import gather

    snapshot = gather(solution)
    outcome: str | NoRoom | None = None
    if snapshot is not None:
        try:
            outcome = _draw(snapshot, solution.summary.get("units", {}), folder)
        except NoRoom as error:
            outcome = error
    outcome = solution.domain.comm.bcast(outcome, root=0)
    if isinstance(outcome, NoRoom):
        raise outcome
    return outcome


def _draw(body: Snapshot, units: Units, folder: Path) -> str | None:
    if not np.isfinite(body.displacement).all():
        return "no picture was drawn: the displacement is not finite"
    target = folder / PICTURE
    try:
        import matplotlib
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        from contact_locking.view.pictures import plane, space, style

        # Matplotlib's global state stays as it is.
        with matplotlib.rc_context(style.RC):
            figure = plane.figure(body, units) if body.dim == 2 else space.figure(body)
            FigureCanvasAgg(figure)
            # Files a sixth larger than by the default compression of 6, in a third of the time.
            how: dict[str, Any] = {"pil_kwargs": {"compress_level": 3}}
            figure.savefig(target, dpi=style.DPI, format="png", facecolor="white", **how)
        # The text files are written later, and matter more.
        require_room(folder, TEXTS_BYTES)
    except NoRendering as reason:
        return f"no picture was drawn: {reason}\nFor pictures in 3D: {space.INSTALL}"
    except Exception as error:
        # An error of the picture must not lose the results of a long solve.
        target.unlink(missing_ok=True)
        if isinstance(error, OSError) and is_full(error):
            where = error.filename or target
            raise NoRoom(f"no picture was drawn: {error.strerror} ({where})") from error
        return f"no picture was drawn: {type(error).__name__}: {error}"
    return None
