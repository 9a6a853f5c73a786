"""Cases as tasks of Slurm's job arrays, on a cluster with a shared file system.

The user sets partition, account and time limit by the variables of sbatch: SBATCH_PARTITION,
SBATCH_ACCOUNT, SBATCH_TIMELIMIT.
"""

from __future__ import annotations

import contextlib
import shlex
import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from contact_locking.errors import ContactLockingError, InputError
from contact_locking.files.ownership import claim, write_text

from .cases import EXIT_CODE, LOG, Case, begin
from .executor import Plan, command, environment, explain

SCRIPT, MESSAGES, JOB = "slurm.sh", "slurm.txt", "slurm-job.txt"
#: The files in the folder of the cases.
FILES = (SCRIPT, MESSAGES, JOB)

# Slurm's MaxArraySize is 1001 by default, and task numbers begin at 0.
_LARGEST_ARRAY = 1000
# A shared file system may show a file later than the queue shows the end of its job.
_SETTLING_SECONDS = 5.0
# Slurm kills what a cancelled job leaves after KillWait, 30 s by default, and a process that waits
# for its disk may outlast that.
_ENDING_SECONDS = 120.0


def require_slurm() -> None:
    """Raise InputError if jobs cannot be submitted here."""
    if shutil.which("sbatch") is None:
        raise InputError(
            "--executor slurm takes sbatch, which is not on the PATH; "
            "start the study on a machine that can submit jobs to Slurm"
        )


class SlurmExecutor:
    """Submits one job array after the other: at most 1000 cases each, of which J run at a time."""

    pause = 1.0

    def __init__(self, cases: Sequence[Case], plan: Plan, directory: Path) -> None:
        self._plan = plan
        self._folder = directory / "cases"
        self._waiting = list(cases)
        self._array: list[_Task] = []
        self._submission: subprocess.Popen[bytes] | None = None
        self._noted = ""
        # The job of a stopped study may still run, and solves the same cases.
        self._earlier = self._cancel()
        self._deadline = time.monotonic() + _ENDING_SECONDS

    @property
    def busy(self) -> bool:
        return bool(self._waiting or self._array)

    @property
    def running(self) -> list[_Task]:
        return [task for task in self._array if task.has_begun()]

    def start(self) -> None:
        """Submit the next array if the one before has ended."""
        if self._waiting and not self._array and not self._earlier_runs():
            self._submit()

    def poll(self) -> list[_Task]:
        """The cases that have ended.  Raises ContactLockingError for what sbatch refuses."""
        if self._submission is None or not self._array:
            return []
        self._note_job()
        over = self._submission.poll() is not None
        if over and self._job() is None:
            raise ContactLockingError(f"sbatch takes no job: {self._messages()}")
        if over:
            self._settle()
        ended = [task for task in self._array if over or task.exit_code() is not None]
        self._array = [task for task in self._array if task not in ended]
        if not self._array:
            self._forget_job()
        return ended

    def stop(self) -> None:
        self._note_job()
        self._cancel()
        if self._submission is not None:
            self._submission.terminate()
            self._submission.wait()

    def _submit(self) -> None:
        cases, self._waiting = self._waiting[:_LARGEST_ARRAY], self._waiting[_LARGEST_ARRAY:]
        for case in cases:
            begin(case)
        self._array = [_Task(case) for case in cases]
        script = self._folder / SCRIPT
        write_text(script, self._script(cases))
        claim(self._folder, [MESSAGES])
        with (self._folder / MESSAGES).open("wb") as messages:
            self._submission = subprocess.Popen(
                ["sbatch", "--wait", "--parsable", str(script)],
                stdin=subprocess.DEVNULL,
                stdout=messages,
                stderr=subprocess.STDOUT,
                env=environment(self._plan.jobs, self._plan.ranks),
                process_group=0,
            )

    def _script(self, cases: Sequence[Case]) -> str:
        tasks = []
        for number, case in enumerate(cases):
            words = shlex.join(command(case, self._plan.program, self._plan.ranks))
            folder = shlex.quote(str(case.folder))
            tasks.append(f"{number}) folder={folder}; set -- {words} ;;")
        return "\n".join(
            [
                "#!/bin/sh",
                "#SBATCH --job-name=contact-locking --output=/dev/null",
                f"#SBATCH --ntasks={self._plan.ranks}",
                f"#SBATCH --array=0-{len(cases) - 1}%{self._plan.jobs}",
                "case $SLURM_ARRAY_TASK_ID in",
                *tasks,
                "esac",
                f'"$@" >"$folder/{LOG}" 2>&1',
                f'echo $? >"$folder/{EXIT_CODE}"',
                "",
            ]
        )

    def _job(self) -> str | None:
        number = self._messages().partition(";")[0].strip()
        return number if number.isdecimal() else None

    def _note_job(self) -> None:
        """Save the number of the job: if this study is killed, the next one cancels the job."""
        number = self._job() if self._array else None
        if number is not None and number != self._noted:
            write_text(self._folder / JOB, number)
            self._noted = number

    def _forget_job(self) -> None:
        (self._folder / JOB).unlink(missing_ok=True)

    def _cancel(self) -> str:
        """Cancel the job whose number is saved, and return its number; empty if there is none.

        The number stays: the processes of a cancelled job go on for some time, and the next study
        waits for their end.
        """
        with contextlib.suppress(OSError):
            job = (self._folder / JOB).read_text()
            subprocess.run(["scancel", job], capture_output=True, check=False)
            return job
        return ""

    def _earlier_runs(self) -> bool:
        """Whether a job cancelled at the start still holds the folders of its cases."""
        if self._earlier and (time.monotonic() > self._deadline or not _is_queued(self._earlier)):
            self._earlier = ""
            self._forget_job()
        return bool(self._earlier)

    def _messages(self) -> str:
        try:
            return (self._folder / MESSAGES).read_text(errors="replace").strip()
        except OSError:
            return ""

    def _settle(self) -> None:
        deadline = time.monotonic() + _SETTLING_SECONDS
        while time.monotonic() < deadline:
            if all(task.exit_code() is not None for task in self._array):
                return
            time.sleep(0.1)


def _is_queued(job: str) -> bool:
    """Whether a job waits, runs or is completing; also if Slurm does not answer now."""
    query = ["squeue", "--noheader", f"--jobs={job}"]
    try:
        answer = subprocess.run(query, capture_output=True, text=True, check=False)
    except OSError:
        return False
    if answer.returncode:
        # Slurm forgets a job some minutes after its end.
        return "Invalid job id" not in answer.stderr
    return bool(answer.stdout.strip())


class _Task:
    """A case of a job array."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self._began: float | None = None

    def has_begun(self) -> bool:
        log = self.case.folder / LOG
        if self._began is None and log.exists():
            self._began = time.monotonic()
        return self._began is not None

    @property
    def seconds(self) -> float:
        return 0.0 if self._began is None else time.monotonic() - self._began

    def exit_code(self) -> int | None:
        try:
            return int((self.case.folder / EXIT_CODE).read_text())
        except (OSError, ValueError):
            return None

    def why(self) -> str:
        code = self.exit_code()
        if code is None:
            return "its job ended early, perhaps at its limit of time or memory; see Slurm's sacct"
        return explain(code, self.case.folder / LOG)
