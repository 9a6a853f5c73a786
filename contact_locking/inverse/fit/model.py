"""The model of measured curves: solves with their derivatives, of which each is kept on disk.

A file ``evaluations/FINGERPRINT.json`` has the quantities of all steps of a solve and their
derivatives: a fit that was killed finds them again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from contact_locking import study_file
from contact_locking.arrays import FloatArray
from contact_locking.errors import ContactLockingError, InputError, NoDerivatives
from contact_locking.files import atomic
from contact_locking.inverse.numbers import with_values
from contact_locking.inverse.sensitivities import value_of
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import on_root
from contact_locking.results.folder import on_root_of
from contact_locking.running.cases import read_mapping
from contact_locking.running.solving import solve_steps
from contact_locking.study_file.parameters import Parameters, SensitivityParameters

from .curves import Case, Experiment

EVALUATIONS = "evaluations"
# The keys of a fit that ask for what the keys of derivatives ask for.
_ASKED = {"sensitivities.of": "fit.quantities", "sensitivities.to": "fit.parameters"}


@dataclass(frozen=True)
class Evaluation:
    """Quantities (k, q) after each of k steps, and their derivatives (k, q, n), if there are any.

    ``times`` are None without steps.  ``used`` is the largest share of the strain limit.
    """

    times: FloatArray | None
    values: FloatArray
    derivatives: FloatArray | None
    used: float | None

    def at(self, times: FloatArray | None, start: float) -> tuple[FloatArray, FloatArray | None]:
        """Values (r, q) and derivatives (r, q, n) at r times, linear between the steps.

        At the time before the first step a body at rest has zeros.
        """
        if times is None or self.times is None:
            return self.values, self.derivatives
        known = self.times if self.times[0] <= start else np.append(start, self.times)

        def between(values: FloatArray) -> FloatArray:
            rest = np.zeros((len(known) - len(values), *values.shape[1:]))
            every = np.concatenate([rest, values])
            return np.apply_along_axis(partial(np.interp, times, known), 0, every)

        slopes = self.derivatives
        return between(self.values), None if slopes is None else between(slopes)


class Model:
    """The solves of all experiments at numbers of the file; collective.

    Evaluations are kept in the first of ``folders``, and found in all of them.  ``derives`` turns
    False where derivatives are not known, as with iterative linear solvers, and ``refusal`` says
    why.
    """

    def __init__(
        self,
        parameters: Parameters,
        experiments: Sequence[Experiment],
        folders: Sequence[Path],
        comm: MPI.Intracomm,
    ) -> None:
        assert parameters.fit is not None
        self.parameters, self._comm, self._folders = parameters, comm, folders
        self.experiments = experiments
        self.quantities = tuple(parameters.fit.quantities.items())
        self.keys = tuple(parameters.fit.parameters)
        self.cases = [case for one in experiments for case in one.cases()]
        self.derives, self.failure, self.refusal = True, "", ""
        self._domains: dict[str, Domain] = {}

    def case_parameters(self, case: Case, numbers: Sequence[float]) -> Parameters:
        """One solve at the numbers.  Raises InputError for values that do not fit."""
        values = {**case.changes, **dict(zip(self.keys, map(float, numbers), strict=True))}
        try:
            return with_values(self.parameters, values)
        except (ValueError, KeyError) as error:
            text = error.args[0] if isinstance(error, KeyError) else str(error)
            raise InputError(
                f"{case.experiment.path}: these values do not fit: {values}; {text}",
                case.experiment.key,
            ) from error

    def evaluate(self, numbers: Sequence[float], is_first: bool) -> list[Evaluation] | None:
        """The solves of all cases; None where one has no solution, with the ``failure``.

        The errors of the ``first`` are raised.
        """
        found = []
        for case in self.cases:
            try:
                one = self._of_case(case, numbers)
            except ContactLockingError as error:
                if is_first:
                    raise
                self.failure = str(error).splitlines()[0]
                return None
            if one is None:
                return None
            found.append(one)
        return found

    def _of_case(self, case: Case, numbers: Sequence[float]) -> Evaluation | None:
        names = [quantity for _, quantity in self.quantities]
        asked = SensitivityParameters(of=tuple(dict.fromkeys(names)), to=self.keys)
        plain = self.case_parameters(case, numbers)
        derived = plain.model_copy(update={"sensitivities": asked})
        fingerprint = on_root(self._comm, partial(study_file.fingerprint, derived))
        while True:
            name = f"{fingerprint}{'' if self.derives else '-values'}.json"
            kept = self._comm.bcast(self._kept(name) if self._comm.rank == 0 else None, root=0)
            if kept is not None:
                return kept
            try:
                found = self._solved(derived if self.derives else plain, names)
            except NoDerivatives as error:
                self.derives, self.refusal = False, str(error)
            except InputError as error:
                key = _ASKED.get(error.key or "", error.key)
                raise InputError(str(error), key) from error
            else:
                if found is not None:
                    on_root_of(self._comm, self._folders[0], partial(self._keep, name, found))
                return found

    def _solved(self, parameters: Parameters, names: Sequence[str]) -> Evaluation | None:
        mesh = f"{parameters.mesh.model_dump()} {parameters.refined_names}"
        times: list[float] = []
        values: list[list[float]] = []
        slopes: list[list[list[float]]] = []
        used: list[float] = []
        for solution in solve_steps(parameters, self._comm, domain=self._domains.get(mesh)):
            self._domains[mesh] = solution.domain
            if not solution.converged:
                told = (solution.reason, solution.suggestion)
                self.failure = ".  ".join(filter(None, told))
                return None
            times.append(solution.time)
            values.append([value_of(name, solution) for name in names])
            if solution.facts.get("limit_used") is not None:
                used.append(solution.facts["limit_used"])
            if parameters.sensitivities is not None:
                derived = solution.facts["sensitivities"]
                slopes.append(
                    [[derived[name][key]["derivative"] for key in self.keys] for name in names]
                )
        found = Evaluation(
            None if parameters.steps is None else np.array(times),
            np.array(values),
            np.array(slopes) if slopes else None,
            max(used, default=None),
        )
        # Sums over ranks are rounded alike on all, and the search takes the same path on each.
        return self._comm.bcast(found, root=0)

    def _kept(self, name: str) -> Evaluation | None:
        every = (read_mapping(folder / EVALUATIONS / name) for folder in self._folders)
        data = next((one for one in every if one is not None), {})
        try:
            times, values, derivatives = (
                None if data[name] is None else np.array(data[name], dtype=float)
                for name in ("times", "values", "derivatives")
            )
            found = Evaluation(times, np.asarray(values, dtype=float), derivatives, data["used"])
        except (KeyError, TypeError, ValueError):
            return None
        return found if found.values.shape[-1:] == (len(self.quantities),) else None

    def _keep(self, name: str, found: Evaluation) -> None:
        folder = self._folders[0] / EVALUATIONS
        folder.mkdir(parents=True, exist_ok=True)
        data = vars(found).items()
        plain = {key: None if one is None else np.asarray(one).tolist() for key, one in data}
        atomic.write_text(folder / name, json.dumps(plain) + "\n")
