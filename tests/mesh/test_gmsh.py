"""Gmsh meshes in silence, is left as it was, and writes whole files or none.

Every process meshes its own copy, so the file runs on any number of ranks.
"""

import signal
import sys
from pathlib import Path

import pytest
from gmsh_groups import make

from contact_locking.meshes import build, write

pytestmark = pytest.mark.serial

gmsh = pytest.importorskip("gmsh")


def test_failed_write_leaves_the_older_file_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "block.msh"
    path.write_text("an older file")

    def fail(name: str) -> None:
        Path(name).write_text("half a mesh")
        raise RuntimeError("disk full")

    monkeypatch.setattr(gmsh, "write", fail)
    with pytest.raises(RuntimeError, match="disk full"):
        write(make("block", h=0.5), path)
    assert path.read_text() == "an older file"
    assert list(tmp_path.iterdir()) == [path]


def test_write_refuses_another_format_and_a_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"\.msh, body\.xdmf"):
        write(make("block"), tmp_path / "body.xdmf")
    with pytest.raises(OSError):
        write(make("block"), tmp_path / "nowhere" / "body.msh")


def test_gmsh_is_silent_and_ignores_the_command_line_and_leaves_signals(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["program", "-clmax", "0.01", "-3", "nothing.geo"])
    handler = signal.getsignal(signal.SIGINT)
    geometry = make("block", h=0.5)
    with build(geometry) as model:
        assert signal.getsignal(signal.SIGINT) is handler
        assert sum(len(tags) for tags in model.mesh.getElements(2)[1]) < 50
    assert signal.getsignal(signal.SIGINT) is handler
    assert not gmsh.isInitialized()
    assert capfd.readouterr() == ("", "")


def test_gmsh_of_the_caller_is_left_as_it_was() -> None:
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 5)
        gmsh.model.add("body")
        gmsh.model.occ.addPoint(1, 2, 3)
        gmsh.model.occ.synchronize()
        with build(make("block", h=0.5)) as model:
            assert len(model.getEntities(2)) == 1
        assert gmsh.isInitialized()
        assert gmsh.option.getNumber("Mesh.Algorithm") == 5
        assert gmsh.model.getCurrent() == "body"
        assert gmsh.model.getEntities() == [(0, 1)]
    finally:
        gmsh.finalize()
