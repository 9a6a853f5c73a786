"""5 000 broken study files: each is accepted or refused with its place, soon, and nothing else."""

from __future__ import annotations

import re
import resource
import subprocess
import sys
import time
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mutations import BOMB, mutate_data, mutate_text

from contact_locking.errors import InputError
from contact_locking.running.cases import cases_of
from contact_locking.study_file import StudyFile, dump, fingerprint, from_mapping, load
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.reading import Source, read

pytestmark = pytest.mark.serial

DEMOS = Path(__file__).parents[2] / "demos"
FILES = sorted([*DEMOS.glob("*.yml"), *DEMOS.glob("studies/*.yml")])
COUNTS = [60, pytest.param(5000, marks=pytest.mark.slow)]

# A file of the permitted size takes 4 s, a case some ms, of which there may be 10 000.
SECONDS, SECONDS_A_CASE = 10.0, 0.02
MEGABYTES = 500


def memory() -> float:
    """The most that this process has ever had, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def use(study: StudyFile) -> int:
    """All that is done with a valid file before a mesh is made; the number of its cases."""
    parameters = study.parameters
    assert re.fullmatch("[0-9a-f]{16}", fingerprint(parameters))
    again = study.source.name + ".again"
    Path(again).write_text(dump(parameters), encoding="utf-8")
    assert load(again).parameters == parameters
    if parameters.study is None:
        return 1
    return len(cases_of(study))


def check(work: Any, place: str) -> None:
    """``work`` returns the number of cases or raises InputError with a place in every line."""
    began, cases = time.process_time(), 1
    try:
        cases = work()
    except InputError as error:
        lines = str(error).split("\n")
        assert len(lines) < 25
        for line in lines:
            assert re.match(place, line) and len(line) < 1500 and line.isprintable(), line
    assert time.process_time() - began < SECONDS + SECONDS_A_CASE * cases


# 10 MB and what is as long as is read, and a few bytes that would become very much.
MONSTERS = {
    "text": b"title: " + b"x" * 10_000_000,
    "noise": Random(0).randbytes(10_000_000),
    "brackets": b"[" * 10_000_000,
    "keys": b"solver: {petsc: {" + b"a: 1, " * 1_700_000 + b"}}",
    "aliases": f"b0: &b0 [x]\n{BOMB}".encode(),
    "merges": b"a: &a {x: 1}\n"
    + b"".join(b"m%d: &m%d {<<: [*a, *a]}\n" % (k, k) for k in range(1000)),
    "cases": b"study: {vary: {penalty.n: {geometric: [1, 2, 10000]}}}\n"
    + b"loads: {tractions: ["
    + b"{on: top, value: [0, 1]}, " * 150
    + b"]}",
    "as many brackets as are read": b"title: " + b"[" * 290_000,
    "as many numbers as are read": b"title: [" + b"1, " * 95_000 + b"]",
    "as many names as are read": b"contact: {on: ["
    + b", ".join(b"n%d" % k for k in range(30_000))
    + b"]}",
}


LONGEST = [name for name in MONSTERS if name.startswith("as many")]
COMMANDS = (["check"], ["run"], ["study"], ["mesh", "-o", "body.msh"])


@pytest.mark.parametrize(
    ("name", "words"),
    [
        *(
            # Hundreds of thousands of faulty values take seconds, and brackets are as many.
            pytest.param(name, COMMANDS[0], marks=pytest.mark.slow if name in LONGEST else ())
            for name in MONSTERS
        ),
        *(("aliases", words) for words in COMMANDS[1:]),
    ],
)
def test_a_monster_is_refused_by_the_command_line_at_once(
    name: str, words: list[str], tmp_path: Path
) -> None:
    (tmp_path / "study.yml").write_bytes(MONSTERS[name])
    command = [sys.executable, "-m", "contact_locking", *words, "study.yml"]
    began = resource.getrusage(resource.RUSAGE_CHILDREN)
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert result.returncode == 2 and result.stdout == ""
    assert result.stderr.startswith("error: ") and result.stderr.count("error: ") == 1
    assert "Traceback" not in result.stderr and len(result.stderr) < 10_000
    assert ended.ru_utime - began.ru_utime < SECONDS
    assert [path.name for path in tmp_path.iterdir()] == ["study.yml"]


@pytest.mark.parametrize("count", COUNTS)
def test_a_file_with_broken_text_is_accepted_or_refused_with_its_place(
    count: int, tmp_path: Path
) -> None:
    path = tmp_path / "study.yml"
    texts = [file.read_bytes() for file in FILES]

    @settings(max_examples=count, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.sampled_from(texts), st.integers(0, 2**64))
    def test(text: bytes, seed: int) -> None:
        path.write_bytes(mutate_text(text, Random(seed)))
        check(lambda: use(load(path)), re.escape(str(path)) + r"(:\d+)?: ")

    before = memory()
    test()
    assert memory() < before + MEGABYTES


@pytest.mark.parametrize("count", COUNTS)
def test_broken_data_are_accepted_or_refused_with_their_key(count: int, tmp_path: Path) -> None:
    contents = [read(file).data for file in FILES]

    @settings(max_examples=count, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.sampled_from(contents), st.integers(0, 2**64))
    def test(content: Any, seed: int) -> None:
        data = mutate_data(content, Random(seed))

        def work() -> int:
            parameters = from_mapping(data, tmp_path)
            assert isinstance(parameters, Parameters)
            return use(StudyFile(parameters, Source(str(tmp_path / "study.yml"), data)))

        check(work, r"\S.*: |there (is text with|may be more)")

    before = memory()
    test()
    assert memory() < before + MEGABYTES
