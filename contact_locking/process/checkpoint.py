"""Solved states in files, which any number of ranks reads on the same mesh, and restarts from them.

A checkpoint is a folder.  ``state.npz`` has the values of the fields, in the order of the mesh
before its distribution, and the coordinates of the nodes, which identify the mesh.  A refined mesh
is stored with it.  ``record.json`` has the format and the checksum of each file, by which files of
other versions and damaged ones are refused.
"""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from contact_locking import files
from contact_locking._version import __version__
from contact_locking.arrays import FloatArray, IntArray
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.certificate.verdict import is_solved
from contact_locking.contact.surface import ContactSurface
from contact_locking.errors import InputError
from contact_locking.fem.compiled import Kept
from contact_locking.files import file_digest
from contact_locking.findings import Finding
from contact_locking.laws.limits import Penalty
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.sources import WholeMesh, gather_cells, gather_mesh, spread
from contact_locking.parallel import on_root
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.contact_points import OPEN
from contact_locking.results.output import CHECKPOINT, RECORD, TEXTS_BYTES
from contact_locking.results.solution import Solution
from contact_locking.results.table import Table
from contact_locking.solver.task import ContactForces, Counts, Multipliers, Outcome, SavedState

# To be raised with every change of the written files.
FORMAT = 9
_STATE, _MESH = "state.npz", "mesh.npz"
_AGAIN = "save it again with contact-locking run --checkpoint"
# The coordinates of the same mesh may differ by this share of the extent, because another machine
# may have made the mesh.
_SAME_PLACE = 1e-9


@dataclass(frozen=True)
class Checkpoint:
    """A saved state on the present mesh.

    Parameters
    ----------
    state
        where a solver may start from; it has no multipliers if the contacts or the sets of strains
        are not those of the problem
    bounds
        the friction bounds (k,) of the contacts, empty without multipliers
    problem
        the fingerprint of the problem of a study file, empty for a script
    converged
        whether the state is a solution
    time, history, halved
        of a step of a process: its time, the rows up to its own, and which steps were halved; the
        history is empty for a state that is no step
    memories
        what friction remembered in the step: ``u_{k-1,tau}`` (k, d) and the slip ``s_{k-1}`` (k,)
    old_displacement
        the local values of ``u_{k-1}``, None unless bodies are paired anew
    """

    state: SavedState
    bounds: tuple[FloatArray, ...]
    problem: str
    converged: bool
    time: float
    history: Table
    halved: tuple[Finding, ...]
    memories: tuple[tuple[FloatArray, FloatArray], ...]
    old_displacement: FloatArray | None

    def solved_again(self, solver: ProblemSolver) -> Outcome | None:
        """The report if the state meets the criteria of a solution, otherwise None; collective."""
        state = self.restored(solver)
        if is_solved(state):
            return state.report
        solver.system.clear()
        return None

    def restored(self, solver: ProblemSolver) -> SolvedState:
        """The saved state as if the solver had found it; collective."""
        contacts, counts, system = solver.problem.contacts, Counts(), solver.system
        system.u.x.array[:] = self.state.displacement
        system.constraints.apply(system.u)
        system.tools.travels = self.state.travels
        # Slips refer to the foundation, so that its travel is restored before them.
        for contact, (place, slip) in zip(contacts, self.memories, strict=False):
            contact.restore_step(place, slip, self.old_displacement)
        if len(self.history):
            counts = Counts(int(self.history.last("tangents")), int(self.history.last("linear")))
        system.bounds.set(contacts, self.bounds)
        assert self.state.multipliers is not None
        outcome = Outcome.solved(self.state.multipliers, from_saved=True)
        return solver.state(outcome.with_counts(counts, ()))


class Layout:
    """The values of functions on rank 0, in an order that no distribution changes; collective.

    The blocks of dofs have the order in which the cells of the mesh, before its distribution, first
    have them.
    """

    def __init__(self, domain: Domain) -> None:
        self._domain, self._orders = domain, dict[int, IntArray | None]()

    def gather(self, function: fem.Function) -> FloatArray | None:
        """The values (n, m) of the n blocks on rank 0; None elsewhere."""
        dofmap = function.function_space.dofmap
        owned = function.x.array.reshape(-1, dofmap.bs)[: dofmap.index_map.size_local]
        gathered, order = self._domain.comm.gather(owned), self._order(function.function_space)
        return None if gathered is None else np.concatenate(gathered)[order]

    def fill(self, function: fem.Function, values: FloatArray | None) -> fem.Function:
        """The function with the values (n, m) that rank 0 has."""
        comm, dofmap = self._domain.comm, function.function_space.dofmap
        order, ends = self._order(function.function_space), comm.gather(dofmap.index_map.size_local)
        shares = None
        if values is not None and ends is not None:
            whole = np.empty_like(values)
            whole[order] = values
            shares = np.split(whole, np.cumsum(ends)[:-1])
        share = comm.scatter(shares)
        function.x.array[: share.size] = share.reshape(-1)
        function.x.scatter_forward()
        return function

    def _order(self, space: fem.FunctionSpace) -> IntArray | None:
        if id(space) not in self._orders:
            dofmap = space.dofmap
            local = dofmap.list[: self._domain.mesh.topology.index_map(self._domain.dim).size_local]
            numbers = dofmap.index_map.local_to_global(local.reshape(-1).astype(np.int32))
            blocks = gather_cells(self._domain, numbers.reshape(local.shape))
            if blocks is not None:
                first = np.unique(blocks, return_index=True)[1]
                self._orders[id(space)] = blocks.reshape(-1)[np.sort(first)].astype(np.int64)
            else:
                self._orders[id(space)] = None
        return self._orders[id(space)]


def gathered(solution: Solution) -> Callable[[Path], None]:
    """A function that writes the checkpoint of a solution as a new folder; collective.

    Rank 0 calls it.  It raises OSError.
    """
    domain, layout = solution.domain, Layout(solution.domain)
    arrays = {name: layout.gather(field) for name, field in _fields(solution).items()}
    mesh = gather_mesh(domain) if domain.is_refined else None
    penalty = solution.state.saved.penalty
    about = {
        "converged": solution.converged,
        "n": penalty.n,
        "epsilon": penalty.epsilon,
        "regularisations": [fields.regularisation for fields in solution.contacts],
        "size": _size_of(domain, solution.displacement),
        "is_refined": domain.is_refined,
        "contacts": len(solution.contacts),
        "strain_sets": len(solution.locking_parts),
        "problem": solution.problem,
        "travels": solution.state.saved.travels,
        "time": solution.time,
        "history": solution.history.columns,
        "halved": [finding.record for finding in solution.halved],
    }

    def write(folder: Path) -> None:
        folder.mkdir()
        if mesh is not None:
            mesh.save(folder / _MESH)
        text = json.dumps(about, default=lambda number: number.item())
        whole: Any = {name: values for name, values in arrays.items() if values is not None}
        np.savez(folder / _STATE, about=text, **whole)
        digests = {path.name: file_digest(str(path)) for path in sorted(folder.iterdir())}
        record = {"format": FORMAT, "version": __version__, "files": digests}
        (folder / RECORD).write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
        # The text files of the results are written later.
        files.require_room(folder, TEXTS_BYTES)

    return write


def locate(directory: str | Path) -> Path:
    """The folder of the checkpoint: ``directory`` itself, or in the folder of a run."""
    folder = Path(directory)
    return folder if (folder / RECORD).is_file() else folder / CHECKPOINT


def require(directory: str | Path) -> Mapping[str, str]:
    """The checksums of a checkpoint of this format; reads no field.

    Raises InputError for a missing or other record, and OSError if it cannot be read.
    """
    path = locate(directory) / RECORD
    if not path.is_file():
        raise InputError(f"there is no checkpoint in {directory}; {_AGAIN}")
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if record["format"] == FORMAT:
            return dict(record["files"])
    except (ValueError, KeyError, TypeError):
        pass
    raise InputError(
        f"{path} is damaged, or was saved by another version than contact_locking {__version__}; "
        f"{_AGAIN}"
    )


def _load(directory: str | Path) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """The description of a checkpoint, and its arrays.  Raises as `require`."""
    folder = locate(directory)
    for name, checksum in require(directory).items():
        path = folder / Path(name).name
        if not path.is_file() or file_digest(str(path)) != checksum:
            raise InputError(f"{path} is missing or damaged; {_AGAIN}")
    with np.load(folder / _STATE) as stored:
        arrays = dict(stored)
    return json.loads(str(arrays.pop("about"))), arrays


def refined_mesh(directory: str | Path | None, comm: MPI.Intracomm) -> Domain | None:
    """The refined mesh that the last checkpoint of a run belongs to; collective.

    None for the mesh of a study, and without a run.  Raises InputError if the checkpoint is
    missing, damaged or of another format.
    """
    if directory is None:
        return None
    meshes: list[WholeMesh] = []

    def load() -> bool:
        last = SavedSteps(Path(directory)).folders[-1]
        if _load(last)[0]["is_refined"]:
            meshes.append(WholeMesh.load(locate(last) / _MESH))
        return bool(meshes)

    return spread(next(iter(meshes), None), comm) if on_root(comm, load) else None


def read(directory: str | Path, problem: DiscreteProblem, is_step: bool = False) -> Checkpoint:
    """The saved state of a run's folder, on the mesh of ``problem``; collective.

    Raises InputError if the checkpoint is missing, damaged, of another mesh or of another format;
    and if it ``is_step`` and is not of a converged step with these contacts.
    """
    comm, arrays = problem.domain.comm, dict[str, FloatArray]()

    def load() -> dict[str, Any]:
        about, loaded = _load(directory)
        arrays.update(loaded)
        return about

    about, layout = on_root(comm, load), Layout(problem.domain)
    _require_same_mesh(about, problem, layout, arrays, directory)

    def field(name: str, space: fem.FunctionSpace) -> fem.Function:
        return layout.fill(fem.Function(space, name=name), arrays.get(name))

    def scalars(name: str, number: int, surface: ContactSurface) -> FloatArray:
        return field(f"{name}_{number}", surface.scalar_space).x.array[surface.nodes]

    def vectors(name: str, number: int, surface: ContactSurface) -> FloatArray:
        values = field(f"{name}_{number}", surface.vector_space).x.array
        return values.reshape(-1, problem.domain.dim)[surface.blocks]

    surfaces = [contact.surface for contact in problem.contacts]
    history = Table(about["history"])
    multipliers: Multipliers | None = None
    bounds, memories, old_displacement = list[FloatArray](), [], None
    is_same = about["contacts"] == len(surfaces) or not surfaces
    if is_same and about["strain_sets"] == len(problem.data.sets):
        forces = []
        for at in enumerate(surfaces):
            forces.append(
                ContactForces(
                    pressure=scalars("contact_pressure", *at),
                    friction=0.0 - vectors("tangential_traction", *at),
                    touches=scalars("contact_state", *at) != OPEN,
                )
            )
            bounds.append(scalars("friction_bound", *at))
            if len(history):
                memories.append((vectors("old_place", *at), scalars("old_slip", *at)))
        mesh = problem.domain.mesh
        multipliers = Multipliers.none(problem.data, Kept(), mesh, tuple(forces))
        for number, y in enumerate(multipliers.parts):
            layout.fill(y, arrays.get(f"locking_stress_{number}"))
        multipliers.add_up(problem.data)
    if comm.bcast("old_displacement" in arrays):
        old_displacement = field("old_displacement", problem.u.function_space).x.array
    if is_step and not (len(history) and about["converged"] and multipliers):
        raise InputError(
            f"{directory} is no checkpoint of a step that has converged, with the same contacts; "
            "a process starts from the last step of a process"
        )
    state = SavedState(
        field("displacement", problem.u.function_space).x.array,
        tuple(about["travels"]),
        Penalty(about["n"], about["epsilon"], tuple(about["regularisations"])),
        multipliers=multipliers,
    )
    return Checkpoint(
        state,
        tuple(bounds),
        about["problem"],
        about["converged"],
        about["time"],
        history,
        tuple(Finding(code, key, **numbers) for code, key, numbers in about["halved"]),
        tuple(memories),
        old_displacement,
    )


def _size_of(domain: Domain, u: fem.Function) -> list[int]:
    """The dimension, cells, nodes and degree of a body, and 1 for a body of revolution."""
    space, shape = u.function_space, int(domain.axisymmetric)
    nodes, degree = int(space.dofmap.index_map.size_global), space.element.basix_element.degree
    return [domain.dim, int(domain.num_cells), nodes, int(degree), shape]


def _require_same_mesh(
    about: Mapping[str, Any],
    problem: DiscreteProblem,
    layout: Layout,
    arrays: Mapping[str, FloatArray],
    directory: str | Path,
) -> None:
    """Raise InputError for a state of another mesh or element; collective."""
    domain = problem.domain
    is_same = about["size"] == _size_of(domain, problem.u)
    if is_same:
        # Another version of Gmsh makes another mesh of the same parameters.
        points = layout.gather(_places(problem.u.function_space))
        if points is not None:
            away = np.abs(arrays["places"] - points).max()
            is_same = bool(away <= _SAME_PLACE * np.abs(points).max())
        is_same = domain.comm.bcast(is_same)
    if not is_same:
        is_adapted = about["is_refined"] and not domain.is_refined
        hint = ", which was refined: add the section adapt" if is_adapted else ""
        raise InputError(
            f"the checkpoint in {directory} is of another mesh or element; restart with mesh "
            f"and discretisation.degree of the run that saved it{hint}"
        )


def _places(space: fem.FunctionSpace) -> fem.Function:
    """The coordinates x as a function; collective."""
    places, dim = fem.Function(space), space.mesh.geometry.dim
    places.interpolate(lambda x: x[:dim])
    return places


def _fields(solution: Solution) -> dict[str, fem.Function]:
    """The stored fields by name; in a step, with what friction remembered in it; collective."""
    fields = {"displacement": solution.displacement}
    fields["places"] = _places(solution.displacement.function_space)
    fields |= {f"locking_stress_{i}": y for i, y in enumerate(solution.locking_parts)}
    for number, contact in enumerate(solution.contacts):
        surface = contact.surface
        scalars = {
            "contact_pressure": contact.pressure,
            "contact_state": contact.state.astype(float),
            "friction_bound": contact.bound,
        }
        vectors = {"tangential_traction": contact.traction}
        if len(solution.history):
            scalars["old_slip"], vectors["old_place"] = contact.old_slip, contact.old_place
            if contact.paired_at is not None:
                fields["old_displacement"] = fem.Function(surface.vector_space)
                fields["old_displacement"].x.array[:] = contact.paired_at
        fields |= {f"{name}_{number}": surface.scalar_function(x) for name, x in scalars.items()}
        fields |= {f"{name}_{number}": surface.vector_function(x) for name, x in vectors.items()}
    return fields


def start_in_words(directory: str | Path, report: Outcome) -> str:
    """How a solve has used the state saved in a folder, in words."""
    if not report.from_saved:
        return f"from scratch, because the state in {directory} did not help"
    if report.tangents == 0:
        return f"the state in {directory} already meets every criterion"
    return f"from the state in {directory}"


class SavedSteps:
    """The steps that a run has saved so far in its folder, from which a killed run goes on.

    The folder of the steps is removed when the run has ended.  The methods are for rank 0.
    """

    def __init__(self, directory: Path) -> None:
        self._directory, self.folder = directory, directory / "steps"
        self._mark = self.folder / "run.json"

    @staticmethod
    def name_of(number: int) -> str:
        """The name of the folder of the step with this number, counted from 1."""
        return f"{number:06d}"

    @property
    def folders(self) -> list[Path]:
        """The saved steps in the order of their times; the saved state if there are none."""
        return self._steps() or [self._directory]

    def last_of(self, fingerprint: str) -> int:
        """The number of the last step that a run with these parameters has saved; 0 without one."""
        with contextlib.suppress(OSError):
            is_same = self._mark.is_file() and self._mark.read_text() == _mark(fingerprint)
            if is_same and (steps := self._steps()):
                return int(steps[-1].name)
        return 0

    def prepare(self, fingerprint: str) -> int:
        """Prepare the folder for the steps of a run, and return :meth:`last_of`.  Raises OSError.

        The saved steps of other parameters are removed.
        """
        last = self.last_of(fingerprint)
        if last == 0:
            self.remove()
            self.folder.mkdir(parents=True, exist_ok=True)
            files.write_text(self._mark, _mark(fingerprint))
        return last

    def keep(self, first: int, last: int) -> None:
        """Remove all saved steps but these."""
        for step in self._steps():
            if not self.name_of(first) <= step.name <= self.name_of(last):
                shutil.rmtree(step, ignore_errors=True)

    def remove(self) -> None:
        """Remove all saved steps, and their folder unless it holds other files."""
        for step in self._steps():
            shutil.rmtree(step, ignore_errors=True)
        self._mark.unlink(missing_ok=True)
        files.remove_abandoned(self.folder)
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _steps(self) -> list[Path]:
        return [record.parent for record in sorted(self.folder.glob(f"[0-9]*/{RECORD}"))]


def _mark(fingerprint: str) -> str:
    return json.dumps({"version": __version__, "fingerprint": fingerprint}) + "\n"
