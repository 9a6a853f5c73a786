"""A trial of PETSc's options on a small block, as PETSc has no list of its options."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contact_locking.errors import ContactLockingError
from contact_locking.parameters import Parameters

if TYPE_CHECKING:
    from mpi4py import MPI


def require_usable_options(parameters: Parameters) -> None:
    """Raise InputError for a harmful PETSc option of the study, or one that is no option."""
    if parameters.solver.petsc:
        from contact_locking.process import problem_solver

        problem_solver.require_usable_options(parameters)


def warnings(parameters: Parameters, dim: int, comm: MPI.Intracomm) -> list[str]:
    """What a solve of a small block says about the options of ``parameters``; collective.

    The block locks, touches and slips, so that every solver is used that the study may use.  An
    option that no solver has asked for may be misspelt, or concern larger problems only.
    """
    if not parameters.solver.petsc:
        return []
    from contact_locking import solving

    try:
        solution = solving.solve(_block(parameters, dim), comm)
    except ContactLockingError as error:
        return [f"solver.petsc: a trial solve of a small block fails: {error}"]
    told: list[str] = solution.summary["warnings"]
    return [
        f"{text}; this was a trial solve of a small block: is the name misspelt?"
        for text in told
        if text.startswith("PETSc has not used")
    ]


def _block(parameters: Parameters, dim: int) -> Parameters:
    """A small block in contact, with the solver of a study."""
    push: list[Any] = [0.03, *[0.0] * (dim - 2), -0.05]
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": dim, "h": 0.25 if dim == 2 else 0.5},
        "material": {"locking_limit": 0.02},
        "loads": {
            "tractions": [{"on": "top", "value": push}],
            "displacements": [{"on": "left", "value": [0.0] * dim}],
        },
        "friction": {"coefficient": 0.3},
        "penalty": {"n": 1e3},
    }
    return Parameters.model_validate(data).model_copy(update={"solver": parameters.solver})
