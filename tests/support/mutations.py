"""Study files as accidents and malice leave them: mutations of text and of data."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from random import Random
from typing import Any

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
    *(
        ", ",
        "[",
        "]",
        "{",
        "}",
        "'",
        '"',
        "#",
        "\t",
        "\n",
        "\r",
        "\r\n",
        "\0",
        "\x1b[31m",
        "\ufeff",
    ),
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
    """One to four changes of the bytes of a file."""
    for _ in range(random.randint(1, 4)):
        text = random.choice(CHANGES)(text, random)
    return text


def _flip(text: bytes, random: Random) -> bytes:
    place = random.randrange(len(text) + 1)
    return text[:place] + bytes([random.randrange(256)]) + text[place + random.randint(0, 1) :]


def _cut(text: bytes, random: Random) -> bytes:
    start = random.randrange(len(text) + 1)
    return text[:start] + text[start + random.randint(1, 40) :]


def _truncate(text: bytes, random: Random) -> bytes:
    return text[: random.randrange(len(text) + 1)]


def _repeat(text: bytes, random: Random) -> bytes:
    start = random.randrange(len(text) + 1)
    end = start + random.randint(1, 60)
    return text[:end] + text[start:end] * random.randint(1, 3) + text[end:]


def _lines(text: bytes, random: Random) -> bytes:
    """Drop, double, move, indent or join lines."""
    lines = text.split(b"\n")
    here, there = random.randrange(len(lines)), random.randrange(len(lines))
    match random.randrange(5):
        case 0:
            del lines[here]
        case 1:
            lines.insert(there, lines[here])
        case 2:
            lines[here], lines[there] = lines[there], lines[here]
        case 3:
            blank = random.choice([b" ", b"  ", b"    ", b"\t", b"- "])
            line = lines[here]
            lines[here] = line.removeprefix(blank) if random.random() < 0.5 else blank + line
        case _:
            lines[here : here + 2] = [b" ".join(lines[here : here + 2])]
    return b"\n".join(lines)


def _replace(pattern: re.Pattern[bytes], new: Callable[[bytes, Random], bytes]) -> Any:
    def change(text: bytes, random: Random) -> bytes:
        found = list(pattern.finditer(text))
        if not found:
            return text
        start, end = random.choice(found).span()
        return text[:start] + new(text[start:end], random) + text[end:]

    return change


def _wrong_value(_: bytes, random: Random) -> bytes:
    return random.choice(WRONG_VALUES).encode()


def _misspelt(name: bytes, random: Random) -> bytes:
    place = random.randrange(len(name))
    return random.choice(
        [
            name[:place] + name[place + 1 :],
            name[:place] + name[place : place + 1] + name[place:],
            name[:place] + name[place : place + 2][::-1] + name[place + 2 :],
            name.upper(),
            name + b".x",
            name.replace(b".", b".."),
        ]
    )


def _syntax(text: bytes, random: Random) -> bytes:
    place = random.randrange(len(text) + 1)
    return text[:place] + random.choice(SYNTAX).encode("utf-8", "surrogatepass") + text[place:]


def _large(text: bytes, random: Random) -> bytes:
    extra = random.choice(LARGE).encode()
    return random.choice([extra + text, text + b"\n" + extra, extra])


CHANGES: list[Callable[[bytes, Random], bytes]] = [
    *(_flip, _cut, _truncate, _repeat, _lines, _lines, _syntax, _syntax, _large),
    *[_replace(NUMBER, _wrong_value)] * 3,
    *[_replace(NAME, _misspelt)] * 2,
]

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
        key = random.choice(keys)
        match random.randrange(5):
            case 0:
                spot[key] = copy.deepcopy(random.choice(ODD))
            case 1:
                del spot[key]
            case 2:
                # From elsewhere in the file.
                spot[key] = copy.deepcopy(random.choice(_containers(data)))
            case 3 if isinstance(spot, dict):
                spot[_misspelt(str(key).encode() or b"x", random).decode()] = spot.pop(key)
            case _ if isinstance(spot, list):
                spot.append(copy.deepcopy(spot[key]))
            case _:
                spot[random.choice(("file", "extra", "n", "on", ""))] = spot[key]
    return data


def _containers(data: Any) -> list[Any]:
    if not isinstance(data, dict | list):
        return []
    below = data.values() if isinstance(data, dict) else data
    return [data, *(inner for item in below for inner in _containers(item))]
