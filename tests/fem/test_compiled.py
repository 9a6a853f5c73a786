"""Forms are compiled into a folder of this package's own, by one process at a time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import dolfinx
import ffcx
import pytest

pytestmark = pytest.mark.serial

SCRIPT = """
import ufl
from dolfinx import fem, jit
from dolfinx.mesh import create_unit_square
from mpi4py import MPI
from contact_locking.command.terminal import ignore_current_folder
print(ignore_current_folder())
from contact_locking.fem import compiled
mesh = create_unit_square(MPI.COMM_SELF, 2, 2)
compiled.form(fem.Constant(mesh, 3.0) * ufl.dx)
compiled.interpolation(fem.Constant(mesh, 3.0) ** 2, fem.functionspace(mesh, ("DG", 0)))
print(jit.get_options(compiled.options()))
"""


def printed(folder: Path) -> str:
    """What the script prints in a folder, which also has configuration and cache."""
    return subprocess.run(
        [sys.executable, "-c", SCRIPT],
        cwd=folder,
        env=os.environ | {"XDG_CONFIG_HOME": str(folder), "XDG_CACHE_HOME": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def test_forms_have_a_folder_of_their_own_in_the_cache(tmp_path: Path) -> None:
    (tmp_path / "dolfinx").mkdir()
    own = {"cffi_extra_compile_args": ["-O1"], "timeout": 700}
    (tmp_path / "dolfinx" / "dolfinx_jit_options.json").write_text(json.dumps(own))
    out = printed(tmp_path)
    (folder,) = (tmp_path / "fenics").iterdir()
    assert dolfinx.__version__ in folder.name and ffcx.__version__ in folder.name
    assert len(list(folder.glob("*/*.c.cached"))) == 2
    # The user's own configuration of DOLFINx holds.
    assert "['-O1']" in out and "'timeout': 700" in out


def test_options_of_the_compiler_in_the_folder_of_a_study_are_ignored(tmp_path: Path) -> None:
    """They can run code: a compiler loads the plugin that -fplugin names."""
    (tmp_path / "dolfinx_jit_options.json").write_text(
        '{"cffi_extra_compile_args": ["-fplugin=x"]}'
    )
    (tmp_path / "ffcx_options.json").write_text('{"scalar_type": "complex128"}')
    out = printed(tmp_path)
    assert out.startswith("['dolfinx_jit_options.json', 'ffcx_options.json']")
    assert "fplugin" not in out
