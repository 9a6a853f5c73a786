"""Which flags forms are compiled with, and that processors with one cache do not share code."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from contact_locking import compiled


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
    (tmp_path / "dolfinx_jit_options.json").write_text(json.dumps(content))
    script = "from contact_locking import compiled; print(compiled.options() == {})"
    printed = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert printed.stdout.strip() == str(said is not None)
