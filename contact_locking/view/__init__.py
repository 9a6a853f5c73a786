"""A wing: pictures, charts and pages of results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking import wings

if TYPE_CHECKING:
    from contact_locking.results.solution import Solution


@wings.PICTURES.add
def _picture(solution: Solution, folder: Path) -> list[str]:
    """The picture of a solution; collective."""
    # Most of what a script imports draws nothing.
    from contact_locking.view.pictures import picture

    problem = picture(solution, folder)
    return [problem] if problem else []
