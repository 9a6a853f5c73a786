"""The solution of a problem from a study file."""

from __future__ import annotations

from dataclasses import dataclass

from contact_locking import study_file
from contact_locking.results.solution import Solution
from contact_locking.study_file.parameters import Parameters


@dataclass(frozen=True, kw_only=True)
class StudySolution(Solution):
    """The solution of a problem from a study file, or of one of its steps."""

    parameters: Parameters

    def fingerprint(self) -> str:
        return study_file.problem_fingerprint(self.parameters)
