"""The files of a run: complete, exact, and all or nothing."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from quadratic_bodies import square
from solutions import made_up

from contact_locking.errors import InputError
from contact_locking.fem.compiled import integral
from contact_locking.results import fields
from contact_locking.results import output as output_folder
from contact_locking.results.solution import StudySolution
from contact_locking.running import run as writing

TEXTS = {"summary.json", "parameters.yaml", "contact.csv", "contact_facets.csv"}
FILES = TEXTS | {"fields.vtkhdf", "picture.png"}


def listing(folder: Path, comm: MPI.Intracomm) -> set[str]:
    comm.Barrier()
    names = {path.name for path in folder.iterdir()}
    comm.Barrier()
    return names


def test_a_run_leaves_the_promised_files_and_nothing_else(
    folder: Path, comm: MPI.Intracomm
) -> None:
    assert writing.write(made_up(), folder / "new" / "results") == []
    assert listing(folder / "new" / "results", comm) == FILES


def test_a_second_run_leaves_nothing_of_the_first(folder: Path, comm: MPI.Intracomm) -> None:
    writing.write(made_up(), folder)
    writing.write(made_up(), folder)
    assert listing(folder, comm) == FILES
    writing.write(made_up(output={"fields": False, "picture": False}), folder)
    assert listing(folder, comm) == TEXTS


@pytest.mark.parametrize("dim", [2, 3])
def test_fields_are_written_without_loss(dim: int) -> None:
    solution = made_up(dim)
    copies = {function.name: function for function in fields.discontinuous(solution)}
    for name in fields.FIELD_NAMES:
        difference = copies[name] - getattr(solution, name)
        error = fem.assemble_scalar(fem.form(ufl.inner(difference, difference) * ufl.dx))
        assert error < 1e-28, name
    assert set(np.unique(copies["contact_state"].x.array)) <= {0.0, 1.0, 2.0}


@pytest.mark.parametrize("make", [made_up, lambda: made_up(3), square])
def test_vtk_reads_the_fields_of_every_rank_at_every_time(
    make: Callable[[], StudySolution], folder: Path, comm: MPI.Intracomm
) -> None:
    reader = pytest.importorskip("vtkmodules.vtkIOHDF").vtkHDFReader()
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    solution, values = make(), []
    with writing.FieldSeries(folder, comm) as series:
        for factor in (2.0, 0.5):
            solution.displacement.x.array[:] *= factor
            series.add(solution)
            functions = fields.discontinuous(solution)
            values.append({f.name: comm.gather(fields.values_at_nodes(f)) or [] for f in functions})
        if comm.rank > 0:
            return
        reader.SetFileName(str(series.path))
        reader.UpdateInformation()
        assert reader.GetNumberOfSteps() == 2
        for step, arrays in enumerate(values):
            reader.SetStep(step)
            reader.Update()
            grid = reader.GetOutputAsDataSet()
            assert grid.GetNumberOfCells() == solution.domain.num_cells
            data = grid.GetPointData()
            assert {data.GetArrayName(i) for i in range(data.GetNumberOfArrays())} == set(arrays)
            for name, parts in arrays.items():
                written = numpy_support.vtk_to_numpy(data.GetArray(name))
                np.testing.assert_array_equal(written, np.concatenate(parts))


@pytest.mark.parametrize("dim", [2, 3])
def test_contact_csv_has_a_row_per_point_in_order(
    dim: int, folder: Path, comm: MPI.Intracomm
) -> None:
    solution = made_up(dim, output={"picture": False})
    writing.write(solution, folder)
    if comm.rank != 0:
        return
    with (folder / "contact.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    axes = "xyz"[:dim]
    vectors = [
        [f"{name}_{a}" for a in axes] for name in ("u_tangent", "traction_tangent", "normal")
    ]
    assert list(rows[0]) == [
        *(*axes, "u_normal", *vectors[0], "gap", "pressure", *vectors[1], "bound", "state"),
        *(*vectors[2], "contact"),
    ]
    assert {row["state"] for row in rows} == {"open", "stick", "slip"}
    facets = np.loadtxt(folder / "contact_facets.csv", delimiter=",", skiprows=1, dtype=int)
    assert facets.shape == ((4, 2) if dim == 2 else (32, 3))
    assert sorted(set(facets.ravel())) == list(range(len(rows)))


def test_the_summary_is_json_that_says_what_is_not_finite(
    folder: Path, comm: MPI.Intracomm
) -> None:
    writing.write(made_up(), folder)
    comm.Barrier()

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    summary = json.loads((folder / "summary.json").read_text(), parse_constant=refuse)
    assert summary["converged"] is True
    assert summary["contact_force"] == [0.0, 0.125]
    assert summary["certificate"]["bounds"]["one"]["bound"] is None
    assert summary["not_finite"] == {"certificate.bounds.one.bound": "inf"}


def test_a_folder_that_cannot_be_written_to_is_bad_input_on_every_rank(
    folder: Path, comm: MPI.Intracomm
) -> None:
    if comm.rank == 0:
        (folder / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot be written to") as caught:
        output_folder.prepare(folder / "file" / "results", comm)
    assert caught.value.key == "output.directory"
    assert listing(folder, comm) == {"file"}


def test_fields_for_paraview_are_quadratic_in_each_cell() -> None:
    solution = square()
    found = {f.name: f for f in fields.discontinuous(solution)}
    assert set(found) == set(fields.FIELD_NAMES)
    assert all(f.function_space.ufl_element().degree == 2 for f in found.values())
    dx = ufl.Measure("dx", domain=solution.domain.mesh)
    for name in ("displacement", "elastic_stress", "locking_stress", "contact_pressure"):
        apart = found[name] - getattr(solution, name)
        assert integral(solution.domain, ufl.inner(apart, apart) * dx) <= 1e-20
    largest = solution.domain.comm.allreduce(found["strain_norm"].x.array.max(), op=MPI.MAX)
    assert largest == pytest.approx(solution.summary["strain_norm_max_in_cells"])
    assert set(np.unique(found["locked"].x.array)) == {0.0, 0.5, 1.0}
    assert set(np.unique(found["contact_state"].x.array)) <= {0.0, 1.0, 2.0}
