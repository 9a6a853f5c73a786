"""contact_locking itself: ``method=interior_point`` or ``penalty``, with ``n`` (inf: exact)."""

from exchange import task
from peer_problems import displaced

from contact_locking import Parameters, solve
from contact_locking.solver.monitor import Monitor

job = task()


class Clock(Monitor):
    """Starts the clock of the task with the first stage of the solver, and stops at its last."""

    started = False

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        """The solver begins; two bodies are solved again with the sides of the last solution."""
        if not self.started:
            self.started = True
            job.start()

    def message(self, text: str) -> None:
        """The solver has ended."""
        job.stop()


changes = {"penalty": {"n": job.number("n")}, "solver": {"method": job.options["method"]}}
study = Parameters.model_validate(job.problem.study | changes)
# The first solve loads the compiled forms.
for _ in range(2):
    solution = solve(study, monitor=Clock())
job.finish(
    displaced(solution)[1],
    solution.summary["iterations"]["tangents"],
    solution.converged,
    pressure=solution.summary["pressure_max"],
    friction=abs(solution.summary["friction_force"][0]),
)
