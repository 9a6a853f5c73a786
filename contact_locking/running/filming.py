"""The film of a process: a snapshot of each step, drawn when the process has ended."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from contact_locking.errors import NoRendering
from contact_locking.monitor import Monitor
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters

if TYPE_CHECKING:
    from contact_locking.extras.pictures.animation import Film


class Filming(Protocol):
    """The settings of a run for its film."""

    def add(self, solution: StudySolution) -> None:
        """Add a solved step; collective."""

    def finish(self, monitor: Monitor) -> tuple[bytes | None, str | None]:
        """The GIF file on rank 0, and why there is none if there should be one; collective."""


def film_of(parameters: Parameters) -> Filming:
    """The film that a study file asks for."""
    wanted = parameters.output
    return _Recording() if wanted.animation and wanted.picture else _Nothing()


class _Nothing:
    def add(self, solution: StudySolution) -> None:
        pass

    def finish(self, monitor: Monitor) -> tuple[bytes | None, str | None]:
        return None, None


class _Recording:
    """The bodies of all steps, on rank 0."""

    def __init__(self) -> None:
        self._film: Film | None = None
        self._solution: StudySolution | None = None
        self._problem: str | None = None

    def add(self, solution: StudySolution) -> None:
        self._solution = solution
        if self._problem is not None:
            return
        try:
            from contact_locking.extras.pictures.animation import MOST_PIECES, Film, Frame
        except ImportError as error:
            self._problem = f"no animation was drawn: {error.name} cannot be imported"
            return
        from contact_locking.extras.pictures.gather import Pieces, gather

        domain = solution.domain
        in_cell = len(Pieces.of(domain.dim, solution.element.degree).nodes)
        if in_cell * domain.num_cells > MOST_PIECES[domain.dim]:
            most = MOST_PIECES[domain.dim] // in_cell
            self._problem = f"no animation was drawn: it is for at most {most} such cells"
            return
        self._film = self._film or Film()
        body = gather(solution)
        if body is not None:
            self._film.add(Frame(len(solution.history), solution.time, body))

    def finish(self, monitor: Monitor) -> tuple[bytes | None, str | None]:
        if self._solution is None:
            return None, None
        drawn: bytes | None = None
        if self._film is not None and len(self._film.frames) > 1:
            from contact_locking.extras.pictures.animation import animation

            monitor.message("drawing the animation")
            try:
                drawn = animation(self._film.frames)
            except NoRendering as reason:
                self._problem = f"no animation was drawn: {reason}"
            except Exception as error:
                # An error of the animation must not lose the results of a long process.
                self._problem = f"no animation was drawn: {type(error).__name__}: {error}"
        self._problem = self._solution.domain.comm.bcast(self._problem, root=0)
        return drawn, self._problem
