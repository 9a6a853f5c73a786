"""The fields of a solved state, written and read by adios4dolfinx or io4dolfinx.

They are stored in the order in which the mesh came from Gmsh, which no distribution changes.  The
places of the nodes are stored with them, and what is read belongs to this mesh where they agree.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from contact_locking import __version__, _compat, study_file
from contact_locking.assembly import Problem, penalty
from contact_locking.checkpoint import record as records
from contact_locking.checkpoint.record import Record
from contact_locking.domain import on_root
from contact_locking.errors import ContactLockingError, InputError
from contact_locking.solution import OPEN, Solution
from contact_locking.solver import SavedState
from contact_locking.solver.multipliers import Multipliers

FloatArray = npt.NDArray[np.float64]

_BODY = ("displacement", "locking_stress")
_CONTACT = ("contact_pressure", "tangential_traction", "contact_state", "friction_bound")
_PLACES = "places"
_DEGREE = 1
# How far a node may be from where it was, as a share of the extent of the body: the same mesh made
# on another machine may differ in its last digits.
_SAME_PLACE = 1e-9
# How much more space than the files take has to be free.
_SPARE = 1.1


@dataclass(frozen=True)
class Checkpoint:
    """A saved state on the present mesh.

    ``multipliers`` and the friction bound (k,) are None where the state knows nothing of the
    present Gamma_C.  ``is_solution`` says that it was saved as the solution for the same mesh,
    material, loads, contact, friction and penalty.
    """

    state: SavedState
    multipliers: Multipliers | None
    bound: FloatArray | None
    is_solution: bool


def unavailable() -> str | None:
    """Why no checkpoint can be written or read here; None if it can be."""
    try:
        _compat.checkpoint_library()
    except ImportError as error:
        return (
            f"checkpoints take adios4dolfinx, which cannot be imported here ({error}); "
            "Debian has it as python3-adios4dolfinx, conda-forge as adios4dolfinx or io4dolfinx"
        )
    return None


def write(solution: Solution, folder: Path) -> None:
    """Write a checkpoint into a folder that exists; collective.

    Raises ContactLockingError where the library or space for the files is missing.
    """
    _require_library()
    parameters, domain = solution.parameters, solution.domain
    touches = bool(parameters.contact.on)
    places = _places(solution.displacement.function_space)
    fields = {name: getattr(solution, name) for name in _BODY + _CONTACT * touches}
    fields[_PLACES] = places
    _compat.prepare_communicator(domain.comm)
    on_root(domain.comm, lambda: _check_space(folder, sum(map(_size, fields.values()))))
    for name, function in fields.items():
        _compat.save_function(folder / records.FIELDS, function, name)
    n, epsilon = penalty(parameters)
    nodes = solution.displacement.function_space.dofmap.index_map.size_global

    def finish() -> None:
        record = Record(
            version=__version__,
            converged=solution.converged,
            n=n,
            epsilon=epsilon,
            dimension=domain.dim,
            degree=_DEGREE,
            cells=domain.num_cells,
            nodes=int(nodes),
            contact=touches,
            mesh=study_file.mesh_identity(parameters),
            problem=study_file.problem_fingerprint(parameters),
        )
        records.save(record, folder)

    on_root(domain.comm, finish)


def expect(directory: str | Path, comm: MPI.Intracomm) -> None:
    """Raise at once what :func:`read` would raise without a look at mesh or fields; collective."""
    on_root(comm, lambda: records.load(directory))
    _require_library()


def read(directory: str | Path, problem: Problem) -> Checkpoint:
    """The state saved in a run's folder, on the mesh of ``problem``; collective.

    Raises InputError if there is none, or if it is damaged, of another mesh or another format, and
    ContactLockingError where the library is missing.
    """
    domain, space = problem.domain, problem.u.function_space
    comm = domain.comm
    expect(directory, comm)
    record, path = on_root(comm, lambda: records.load_fields(directory))
    parameters = problem.parameters
    identity = on_root(comm, lambda: study_file.mesh_identity(parameters))
    _check_mesh(record, directory, problem, identity)

    _compat.prepare_communicator(comm)

    def load(name: str, into: fem.FunctionSpace) -> fem.Function:
        function = fem.Function(into, name=name)
        _compat.load_function(path, function, name)
        return function

    expected = _places(space).x.array
    distance = np.abs(load(_PLACES, space).x.array - expected).max(initial=0.0)
    extent = comm.allreduce(float(np.abs(expected).max(initial=0.0)), op=MPI.MAX)
    if comm.allreduce(float(distance), op=MPI.MAX) > _SAME_PLACE * extent:
        raise InputError(_another_mesh(directory, "its nodes lie elsewhere", record, identity))
    displacement = load("displacement", space).x.array
    multipliers = bound = None
    if problem.bound is None or record.contact:
        tensors = fem.functionspace(domain.mesh, ("DG", 0, (domain.dim, domain.dim)))
        none = np.zeros(0)
        multipliers = Multipliers(load("locking_stress", tensors), none, none, none.astype(bool))
    if problem.bound is not None and multipliers is not None:
        surface = problem.bound.surface
        nodal = {
            name: load(name, surface.scalar_space).x.array[surface.nodes]
            for name in _CONTACT
            if name != "tangential_traction"
        }
        traction = load("tangential_traction", space).x.array.reshape(-1, domain.dim)
        multipliers = Multipliers(
            multipliers.locking_stress,
            nodal["contact_pressure"],
            0.0 - traction[surface.blocks],
            nodal["contact_state"] != OPEN,
        )
        bound = nodal["friction_bound"]
    same = on_root(comm, lambda: study_file.problem_fingerprint(parameters)) == record.problem
    pressure = None if bound is None or multipliers is None else multipliers.pressure
    state = SavedState(displacement, pressure, record.n, record.epsilon)
    return Checkpoint(state, multipliers, bound, record.converged and same)


def _require_library() -> None:
    reason = unavailable()
    if reason is not None:
        raise ContactLockingError(reason)


def _places(space: fem.FunctionSpace) -> fem.Function:
    """``x`` as a function."""
    places = fem.Function(space)
    dim = space.mesh.geometry.dim
    places.interpolate(lambda x: x[:dim])
    return places


def _size(function: fem.Function) -> int:
    """Bytes in a file: values, and for every cell its degrees of freedom and some more."""
    dofmap, mesh = function.function_space.dofmap, function.function_space.mesh
    cells = mesh.topology.index_map(mesh.topology.dim).size_global
    values = dofmap.index_map.size_global * dofmap.index_map_bs
    return int(8 * values + cells * (8 * dofmap.bs * dofmap.list.shape[1] + 12))


def _check_space(folder: Path, size: int) -> None:
    """Before it is written: on several ranks the library does not survive a full disk."""
    free = shutil.disk_usage(folder).free
    if free < _SPARE * size:
        megabytes = (f"{number / 1e6:.3g} MB" for number in (size, free))
        raise ContactLockingError("a checkpoint takes {}, and {} are free".format(*megabytes))


def _check_mesh(
    record: Record, directory: str | Path, problem: Problem, identity: dict[str, Any]
) -> None:
    """Sizes first: a mesh of other sizes cannot even be compared node by node."""
    if record.degree != _DEGREE:
        raise InputError(
            f"the checkpoint in {directory} holds elements of degree {record.degree}; "
            f"degree {_DEGREE} is needed"
        )
    nodes = int(problem.u.function_space.dofmap.index_map.size_global)
    here = (problem.domain.dim, problem.domain.num_cells, nodes)
    there = (record.dimension, record.cells, record.nodes)
    if here != there:
        text = "{}D with {} cells and {} nodes"
        difference = f"it is {text.format(*there)}, this one is {text.format(*here)}"
        raise InputError(_another_mesh(directory, difference, record, identity))


def _another_mesh(
    directory: str | Path, difference: str, record: Record, identity: dict[str, Any]
) -> str:
    """The message, with what differs in the parameters of the mesh."""
    names = [name for name in {**record.mesh, **identity} if name != "content"]
    changes = [
        f"mesh.{name} was {record.mesh.get(name)}, is {identity.get(name)}"
        for name in names
        if record.mesh.get(name) != identity.get(name)
    ]
    if record.mesh.get("content") != identity.get("content"):
        changes = ["the mesh file is another one or has changed"]
    # Of the same parameters another Gmsh makes another mesh.
    told = "; ".join(changes) or "by another version of Gmsh? A mesh.file stays what it is"
    return (
        f"the checkpoint in {directory} is of another mesh: {difference} ({told}); "
        "a restart takes the mesh that the state was solved on"
    )
