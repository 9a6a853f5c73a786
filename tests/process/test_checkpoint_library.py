"""Which library saves states, by what is installed."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from contact_locking import _compat

pytestmark = pytest.mark.serial


def install(monkeypatch: pytest.MonkeyPatch, **modules: ModuleType | None) -> None:
    """Put modules in place of those that are installed; None is a module that is missing."""
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)


@pytest.mark.parametrize("has_mpi", [True, False, None])
def test_io4dolfinx_writes_hdf5_unless_adios2_has_mpi(
    has_mpi: bool | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    library, adios2, backends = ModuleType("io4dolfinx"), ModuleType("adios2"), []
    adios2.__dict__["is_built_with_mpi"] = has_mpi
    library.__dict__["set_default_backend"] = backends.append
    present = None if has_mpi is None else adios2
    install(monkeypatch, adios4dolfinx=None, io4dolfinx=library, adios2=present)
    assert _compat.checkpoint_library() is library
    assert backends == ([] if has_mpi else ["h5py"])


def test_adios4dolfinx_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    first = ModuleType("adios4dolfinx")
    install(monkeypatch, adios4dolfinx=first, io4dolfinx=ModuleType("io4dolfinx"))
    assert _compat.checkpoint_library() is first


def test_without_a_library_the_reason_is_that_of_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, adios4dolfinx=None, io4dolfinx=None)
    with pytest.raises(ImportError, match="adios4dolfinx"):
        _compat.checkpoint_library()
