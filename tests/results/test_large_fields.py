"""The fields of a large mesh are those of a small one, in a format that takes less memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from problems import block
from slow import slow

from contact_locking import solve
from contact_locking.results import fields


@pytest.mark.parametrize("dim", [2, slow(3)])
def test_a_large_file_has_the_fields_of_a_small_one(
    dim: int, comm: MPI.Intracomm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    adios2 = pytest.importorskip("adios2")
    folder = comm.bcast(tmp_path)
    functions = fields.discontinuous(solve(block(dim, 0.5), comm))
    for name, largest in (
        ("small", fields._LARGEST_BP4),
        ("large", fields.size(functions, comm) - 1),
    ):
        monkeypatch.setattr(fields, "_LARGEST_BP4", largest)
        file = fields.Series(functions, folder / f"{name}.bp", comm)
        file.add(0.0)
        file.close()
    if comm.rank > 0:
        return
    # Only a file in the format BP5 has metadata of metadata.
    assert (folder / "large.bp" / "mmd.0").exists()
    assert not (folder / "small.bp" / "mmd.0").exists()
    with (
        adios2.FileReader(str(folder / "small.bp")) as small,
        adios2.FileReader(str(folder / "large.bp")) as large,
    ):
        names = set(small.available_variables())
        assert names == set(large.available_variables())
        assert names >= {function.name for function in functions}
        for name in names:
            np.testing.assert_array_equal(small.read(name), large.read(name))
