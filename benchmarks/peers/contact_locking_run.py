"""contact_locking itself: ``method=interior_point`` or ``penalty``, with ``n`` (inf: exact)."""

from exchange import task
from peer_problems import displaced

from contact_locking import Parameters, solve
from contact_locking.monitor import Monitor

job = task()


class Clock(Monitor):
    """Starts the clock of the task with the first stage of the solver, and stops at its last."""

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        """The solver begins."""
        if index == 1:
            job.start()

    def message(self, text: str) -> None:
        """The solver has ended."""
        job.stop()


changes = {"penalty": {"n": job.number("n")}, "solver": {"method": job.options["method"]}}
study = Parameters.model_validate(job.problem.study | changes)
solution = solve(study, monitor=Clock())
job.finish(
    displaced(solution)[1],
    solution.summary["iterations"]["tangents"],
    solution.converged,
    pressure=solution.summary["pressure_max"],
    friction=abs(solution.summary["friction_force"][0]),
)
