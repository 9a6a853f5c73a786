"""Shared by all tests: the communicator, and collective destruction of PETSc objects."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest
from mpi4py import MPI


@pytest.fixture
def comm() -> MPI.Intracomm:
    return MPI.COMM_WORLD


@pytest.fixture(autouse=True)
def collect_petsc_objects() -> Iterator[None]:
    """PETSc's destructors are collective: run them at the same place on every rank."""
    yield
    if MPI.COMM_WORLD.size > 1:
        gc.collect()
        MPI.COMM_WORLD.Barrier()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if MPI.COMM_WORLD.size > 1:
        skip = pytest.mark.skip(reason="makes sense on one rank only")
        for item in items:
            if "serial" in item.keywords:
                item.add_marker(skip)
