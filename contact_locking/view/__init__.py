"""A wing: pictures, charts and pages of results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking import wings

if TYPE_CHECKING:
    from contact_locking.results.solution import StudySolution


@wings.FILES.add
def _picture(solution: StudySolution, folder: Path) -> list[str]:
    """The picture of a run, if it is asked for; collective."""
    if not solution.parameters.output.picture:
        return []
    # Most of what a script imports draws nothing.
    from contact_locking.view.pictures import picture

    problem = picture(solution, folder)
    return [problem] if problem else []
