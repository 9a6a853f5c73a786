"""A compiled form that nobody finishes is removed, and one that is being compiled is left alone."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import pytest

from contact_locking.fem import compiled_forms

pytestmark = pytest.mark.serial


def test_a_form_that_a_killed_process_left_unfinished_is_removed(tmp_path: Path) -> None:
    ready, old, young = (tmp_path / f"libffcx_forms_{name}.c" for name in ("a", "b", "c"))
    for path in (ready, old, young):
        path.touch()
    (tmp_path / f"{ready.name}.cached").touch()
    lonely = tmp_path / "libffcx_forms_d.c.cached"
    lonely.touch()
    os.utime(old, (0, 0))
    began = time.monotonic()
    compiled_forms.clear(tmp_path, 0.3)
    assert 0.2 < time.monotonic() - began < 5
    assert ready.exists() and not any(path.exists() for path in (old, young, lonely))


def test_a_form_that_a_process_compiles_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "libffcx_forms_slow.c"
    path.write_text("a line\n")
    os.utime(path, (0, 0))
    with subprocess.Popen(["tail", "-f", str(path)], stdout=subprocess.PIPE) as compiler:
        # A process that has just begun has no command line yet.
        assert compiler.stdout is not None
        compiler.stdout.readline()
        compiled_forms.clear(tmp_path, 0.3)
        assert path.exists()
        compiler.terminate()
    compiled_forms.clear(tmp_path, 0.3)
    assert not path.exists()
