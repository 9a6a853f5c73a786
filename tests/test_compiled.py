"""Which flags are compiled with, what is kept, and that processors with one cache share no code."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cffi
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import create_unit_square
from mpi4py import MPI

from contact_locking.errors import ContactLockingError
from contact_locking.fem import compiled, compiled_forms


@pytest.fixture(autouse=True)
def _asked_anew() -> Iterator[None]:
    compiled.options.cache_clear()
    yield
    compiled.options.cache_clear()


def test_forms_are_compiled_for_the_processor_at_hand() -> None:
    arguments = compiled.options()["cffi_extra_compile_args"]
    assert {"-O3", "-march=native"} <= set(arguments)


def test_another_processor_has_other_forms_in_the_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    here = compiled.options()
    monkeypatch.setattr(compiled, "_instructions", lambda: ["flags: fpu sse2"])
    compiled.options.cache_clear()
    there = compiled.options()
    # FFCx makes the arguments a part of the name of what it compiles.
    assert there != here


def test_a_processor_keeps_its_name() -> None:
    first = compiled.options()
    compiled.options.cache_clear()
    assert compiled._instructions()
    assert compiled.options() == first


def test_an_unknown_processor_gets_no_instructions_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(compiled, "_instructions", list)
    assert compiled.options() == {}


@pytest.mark.serial  # it starts another MPI program
@pytest.mark.parametrize("said", [["-O1"], None])
def test_dolfinx_own_file_of_options_wins(tmp_path: Path, said: list[str] | None) -> None:
    content = {} if said is None else {"cffi_extra_compile_args": said}
    (tmp_path / "dolfinx").mkdir()
    (tmp_path / "dolfinx" / "dolfinx_jit_options.json").write_text(json.dumps(content))
    script = "from contact_locking.problem import compiled; print(compiled.options() == {})"
    printed = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"XDG_CONFIG_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert printed.stdout.strip() == str(said is not None)


@pytest.mark.serial
def test_options_of_the_compiler_in_the_folder_of_a_study_are_ignored(tmp_path: Path) -> None:
    """They can run code: a compiler loads the plugin that -fplugin names."""
    (tmp_path / "dolfinx_jit_options.json").write_text(
        '{"cffi_extra_compile_args": ["-fplugin=x"]}'
    )
    (tmp_path / "ffcx_options.json").write_text('{"scalar_type": "complex128"}')
    script = """
from contact_locking.fem import compiled, compiled_forms
print(compiled_forms.ignore_current_folder())
import ffcx, dolfinx.jit
print(compiled.options(), dolfinx.jit.get_options(), ffcx.get_options())
"""
    printed = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert printed.startswith("['dolfinx_jit_options.json', 'ffcx_options.json']")
    assert "fplugin" not in printed and "complex" not in printed


def test_an_unfinished_form_of_another_process_is_named(tmp_path: Path) -> None:
    """FFCx waits for a form that another process compiles, which may have been killed."""
    from ffcx.codegeneration.jit import get_cached_module

    (tmp_path / "libffcx_forms_0.c").touch()
    with (
        pytest.raises(ContactLockingError, match=r"if it was killed, delete .*libffcx_forms_0\.c"),
        compiled_forms.explained(),
    ):
        get_cached_module("libffcx_forms_0", [], tmp_path, timeout=0)


def test_a_form_that_a_process_has_loaded_is_not_searched_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = create_unit_square(MPI.COMM_WORLD, 2, 2)

    def area() -> float:
        return float(fem.assemble_scalar(compiled.form(fem.Constant(mesh, 2.0) * ufl.dx)))

    # The first call may compile the form, and the second loads it then.
    here = area()
    assert area() == here
    finders: list[str] = []
    monkeypatch.setattr("importlib.machinery.FileFinder.find_spec", finders.append)
    assert area() == here and finders == []


def test_another_folder_of_the_cache_has_forms_of_its_own(tmp_path: Path) -> None:
    mesh = create_unit_square(MPI.COMM_SELF, 2, 2)
    for folder in (tmp_path / "a", tmp_path / "b"):
        form = fem.form(fem.Constant(mesh, 3.0) * ufl.dx, jit_options={"cache_dir": folder})
        assert fem.assemble_scalar(form) == pytest.approx(3.0)
        assert len(list(folder.glob("*.c"))) == 1


DOUBLED = ("double doubled(double x);", "double doubled(double x) { return 2.0 * x; }")
TRIPLED = ("double tripled(double x);", "double tripled(double x) { return 3.0 * x; }")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    found = {"cache_dir": tmp_path / "fenics", "cffi_extra_compile_args": ["-O1"]}
    monkeypatch.setattr("dolfinx.jit.get_options", lambda *_: found)
    compiled._library.cache_clear()
    return tmp_path / "fenics"


def test_functions_of_c_are_compiled_once(cache: Path) -> None:
    def doubled(x: float) -> float:
        compiled._library.cache_clear()
        return float(compiled.library("numbers", *DOUBLED, MPI.COMM_SELF)[0].doubled(x))

    assert doubled(1.5) == 3.0
    (kept,) = cache.iterdir()
    when = kept.stat().st_mtime_ns
    assert doubled(2.0) == 4.0
    assert [path.stat().st_mtime_ns for path in cache.iterdir()] == [when]
    assert compiled.library("numbers", *TRIPLED, MPI.COMM_SELF)[0].tripled(1.0) == 3.0
    assert len(list(cache.iterdir())) == 2


def test_functions_that_do_not_compile_leave_nothing_in_the_cache(cache: Path) -> None:
    with pytest.raises(cffi.VerificationError):
        compiled.library("numbers", DOUBLED[0], "double doubled(double x) {", MPI.COMM_SELF)
    assert list(cache.iterdir()) == []
