"""A sample of broken study files: each is accepted or refused with its place, and soon."""

from __future__ import annotations

import copy
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

from contact_locking.errors import InputError
from contact_locking.running.cases import cases_of
from contact_locking.study_file import StudyFile, dump, fingerprint, from_mapping, load
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.reading import Source, read

pytestmark = pytest.mark.serial


NUMBER = re.compile(rb"(?<![\w.])[-+]?\.?\d[\w.+-]*+")
NAME = re.compile(rb"(?<![\w.])[A-Za-z_][\w.]*+(?=:)")

WRONG_VALUES = (
    *("nan", ".nan", "inf", ".inf", "-.inf", "-1", "0", "-0.0", "1e400", "1e308", "1e-400"),
    *("5e-324", "99999999999999999999", "9" * 400, "9" * 5000, "0x1F", "0o17", "1_000", "1:30"),
    *("'1'", '"1"', "text", "", "~", "null", "true", "no", "[]", "{}", "[1, 2]", "{a: 1}"),
    *("2024-01-01", "0.1.2", "1/0", "9**9**9", "2**1000", "sqrt(-1)", "x", "s", "x/0", "10**-400"),
    *("x if y < 0.5", "__import__('os')", "[[[]]]", "'\\0'", "1e3 ", "١٢", "1,5", "=1", "-"),
)
# Syntax of YAML, and what editors and other systems leave in files.
SYNTAX = (
    *("&a ", "*a", "<<: *a", "<<: {}", "!!python/object/apply:os.system [true] ", "!x "),
    *("!!binary aGk=", "? ", "| ", "> ", "|+\n", "%YAML 1.1\n---\n", "---\n", "...\n", "- ", ": "),
    *(", ", "[", "]", "{", "}", "'", '"', "#", "\t", "\n", "\r", "\r\n"),
    *("\0", "\x1b[31m", "\ufeff"),
    *("\u2028", "\u0085", "@", "`", "é", "\U0001f600", '"\\ud800"', "\\", "%"),
)
BOMB = "".join(f"b{k}: &b{k} [{', '.join([f'*b{k - 1}'] * 9)}]\n" for k in range(1, 12))
LARGE = (
    f"b0: &b0 [x]\n{BOMB}",
    f"title: {'x' * 300_000}\n",
    f"title: {'[' * 2000}\n",
    f"title: {'[' * 300}{']' * 300}\n",
    "".join(f"{' ' * depth}a:\n" for depth in range(400)),
    f"{'a: ' * 1000}\n",
    f"material: {{locking_limit: {'(' * 400}1{')' * 400}}}\n",
    f"material: {{locking_limit: {'1+' * 5000}1}}\n",
    f"loads: {{tractions: [{'{on: top, value: [0, 1]}, ' * 2000}]}}\n",
    f"contact: [{'{gap: x, friction: {coefficient: s}}, ' * 2000}]\n",
    "".join(f"key_{k}: {k}\n" for k in range(5000)),
    f"study: {{vary: {{{', '.join(f'k{k}: [1, 2]' for k in range(300))}}}}}\n",
    "study: {vary: {penalty.n: {geometric: [1, 1e9, 300]}}}\n",
    "study: {vary: {penalty.n: {geometric: [1, 1e9, 10000]}, title: {linear: [0, 1, 10000]}}}\n",
)


def mutate_text(text: bytes, random: Random) -> bytes:
    """One to four changes of the bytes of a file: a part of it gives way to something else."""
    for _ in range(random.randint(1, 4)):
        start, end = _part(text, random)
        text = text[:start] + _other(text[start:end], text, random) + text[end:]
    return text


def _part(text: bytes, random: Random) -> tuple[int, int]:
    """A number, a name, a line, some bytes, or nothing at some place."""
    kinds = [NUMBER, NAME, re.compile(rb"(?m)^.*$"), re.compile(rb"(?s).{0,40}"), None]
    pattern = random.choice(kinds)
    if pattern is not None and (found := list(pattern.finditer(text))):
        return random.choice(found).span()
    place = random.randrange(len(text) + 1)
    return place, place


def _other(part: bytes, text: bytes, random: Random) -> bytes:
    """What a part gives way to: a piece of YAML, of the file or of itself, misspelt, or nothing."""
    start = random.randrange(len(text) + 1)
    pieces = [random.choice(WRONG_VALUES), random.choice(SYNTAX), random.choice(LARGE)]
    return random.choice(
        [
            *(piece.encode("utf-8", "surrogatepass") for piece in pieces),
            text[start : start + random.randint(1, 60)] * random.randint(1, 3),
            random.choice([b" ", b"    ", b"\t", b"- "]) + part,
            _misspelt(part or b"x", random),
            random.randbytes(1),
            b"",
        ]
    )


def _misspelt(name: bytes, random: Random) -> bytes:
    place = random.randrange(len(name))
    swapped = name[:place] + name[place : place + 2][::-1] + name[place + 2 :]
    return random.choice([swapped, name[:place] + name[place + 1 :], name.upper(), name + b".x"])


ODD: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 2, 3, 10**9, 10**400, -(10**30), 0.0, -0.0, 1e308, 5e-324, 0.5),
    *(float("nan"), float("inf"), float("-inf"), "", " ", "x", "nan", "inf", "1e400", "\0"),
    *("\ud800", "x" * 100_000, "1+" * 10_000 + "1", "(" * 5000, "9**9**9", "-x", "../..", "/"),
    *("\u2028", [], {}, [None], [[]], [{}], [0] * 10_000, {"": 1}, {"a.b": 1}, {"x" * 10_000: {}}),
)


def mutate_data(data: Any, random: Random) -> Any:
    """A copy with one to four changes of its values, keys or order."""
    data = copy.deepcopy(data)
    for _ in range(random.randint(1, 4)):
        spot = random.choice(_containers(data))
        keys = list(spot) if isinstance(spot, dict) else list(range(len(spot)))
        if not keys:
            continue
        key, elsewhere = random.choice(keys), copy.deepcopy(random.choice(_containers(data)))
        value = random.choice([copy.deepcopy(random.choice(ODD)), elsewhere, spot[key]])
        if random.random() < 0.3:
            del spot[key]
        elif isinstance(spot, list):
            spot.insert(key, value)
        else:
            names = [key, key, _misspelt(str(key).encode() or b"x", random).decode(), "file", "on"]
            spot[random.choice(names)] = value
    return data


def _containers(data: Any) -> list[Any]:
    if not isinstance(data, dict | list):
        return []
    below = data.values() if isinstance(data, dict) else data
    return [data, *(inner for item in below for inner in _containers(item))]


DEMOS = Path(__file__).parents[2] / "demos"
FILES = sorted([*DEMOS.glob("*.yml"), *DEMOS.glob("studies/*.yml")])
EXAMPLES = 60

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


# 10 MB, and a few bytes that would become very much.
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
}


COMMANDS = (["check"], ["run"], ["study"], ["mesh", "-o", "body.msh"])


@pytest.mark.parametrize(
    ("name", "words"),
    [*((name, COMMANDS[0]) for name in MONSTERS), *(("aliases", words) for words in COMMANDS[1:])],
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


def test_a_file_with_broken_text_is_accepted_or_refused_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "study.yml"
    texts = [file.read_bytes() for file in FILES]

    @settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.sampled_from(texts), st.integers(0, 2**64))
    def test(text: bytes, seed: int) -> None:
        path.write_bytes(mutate_text(text, Random(seed)))
        check(lambda: use(load(path)), re.escape(str(path)) + r"(:\d+)?: ")

    before = memory()
    test()
    assert memory() < before + MEGABYTES


def test_broken_data_are_accepted_or_refused_with_their_key(tmp_path: Path) -> None:
    contents = [read(file).data for file in FILES]

    @settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
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
