"""Fixtures of many tests: the communicator, several ranks, and the verification table."""

from __future__ import annotations

import gc
import io
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from report_folder import run_folder
from verification_table import Rows, table_text

RANK, SIZE = MPI.COMM_WORLD.rank, MPI.COMM_WORLD.size

# For the programs that tests start: Open MPI's ranks wait by spinning, which is slow where they
# share cores with other tests.
os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")

# Ranks must draw the same examples and not judge them by their clocks; what decides whether a
# change may land must not be a lottery.  New examples are for the slow tests.
hypothesis.settings.register_profile("same", derandomize=True, database=None, deadline=None)


ROWS = Rows()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--table", type=Path, help="write what the verification tests found here")


@pytest.fixture
def found() -> Rows:
    """The table of docs/verification.md; a test adds its rows."""
    return ROWS


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Numbers of tests that failed are no documentation."""
    path = session.config.getoption("--table")
    if path is not None and RANK == 0 and exitstatus == 0:
        unfinished = path.with_suffix(".partial")
        unfinished.write_text(table_text(ROWS), encoding="utf-8")
        unfinished.replace(path)


@pytest.fixture
def comm() -> MPI.Intracomm:
    return MPI.COMM_WORLD


@pytest.fixture
def folder(tmp_path: Path, comm: MPI.Intracomm) -> Path:
    """The same folder on all ranks."""
    found: Path = comm.bcast(tmp_path)
    return found


@pytest.fixture(scope="session")
def kept_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run in two dimensions."""
    return run_folder(tmp_path_factory.mktemp("run"))


@pytest.fixture
def own_run(kept_run: Path, tmp_path: Path) -> Path:
    """A copy of these results for one test."""
    return Path(shutil.copytree(kept_run, tmp_path / "run"))


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Charts are composed and not rendered, which takes most of the time of a report."""
    rendered = "contact_locking.view.report.page._rendered"
    monkeypatch.setattr(rendered, lambda drawing: ('<svg viewBox=""></svg>', b""))


@pytest.fixture(autouse=True)
def collect_petsc_objects() -> Iterator[None]:
    """PETSc's destructors are collective: run them at the same place on every rank."""
    yield
    if SIZE > 1:
        gc.collect()
        MPI.COMM_WORLD.Barrier()


@pytest.fixture(autouse=True)
def options_of_petsc() -> Iterator[None]:
    """Options left in PETSc's database would change the solvers of the tests that follow."""
    yield
    left = [name for name in PETSc.Options().getAll() if name.startswith("contact_locking")]
    for name in left:
        PETSc.Options().delValue(name)
    assert not left


def pytest_collection_finish() -> None:
    """What is there before the first test stays: no collection between tests looks at it again."""
    if SIZE > 1:
        gc.collect()
        gc.freeze()


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    # Before any test is collected, and with it the settings that hold then.
    if SIZE > 1 or config.option.markexpr == "not slow":
        hypothesis.settings.load_profile("same")
    # Rank 0 speaks for all, but for failures: those of the other ranks are printed below.
    if RANK > 0:
        reporter = config.pluginmanager.unregister(name="terminalreporter")
        assert reporter is not None
        silent = type(reporter)(config, io.StringIO())
        config.pluginmanager.register(silent, "terminalreporter")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if RANK > 0 and report.failed:
        sections = "".join(f"\n--- {title} ---\n{text}" for title, text in report.sections)
        _say(f"{report.nodeid} failed ({report.when})\n{report.longreprtext}{sections}")


def pytest_collectreport(report: pytest.CollectReport) -> None:
    if RANK > 0 and report.failed:
        _say(f"{report.nodeid} cannot be collected\n{report.longreprtext}")


def pytest_internalerror(excrepr: object) -> None:
    if RANK > 0:
        _say(f"error inside pytest\n{excrepr}")


def _say(message: str) -> None:
    """Print at once: the other ranks may wait for this one for ever."""
    print(f"\n=== rank {RANK}: {message}", flush=True)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if SIZE > 1:
        skip = pytest.mark.skip(reason="makes sense on one rank only")
        for item in items:
            if "serial" in item.keywords:
                item.add_marker(skip)
