"""A study file to begin with: a demo with the description of every key beside it."""

from __future__ import annotations

import json
import math
import re
import shlex
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel

from contact_locking.errors import InputError
from contact_locking.meshes import BUILDERS
from contact_locking.plain_text import nearest, printable
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.base import unit_of
from contact_locking.study_file.parameters.keys import section_in, visible_fields
from contact_locking.study_file.parameters.mesh import MeshParameters
from contact_locking.study_file.parameters.wording import show

from .source import read

_DEMOS = Path(__file__).parent / "demos"
_INDENT = "  "
# The column of the comments, and the width of the file.
_COMMENTS, _WIDTH = 40, 120
# Text that YAML reads as text without quotes, also inside [ ] and { }.
_PLAIN_TEXT = re.compile(r"-?[\w(.][\w ./*+()=<>-]*(?<! )")
_NOT_TEXT = ("true", "false", "null", ".inf", ".nan", "-.inf")

_HEAD = """\
# A study file of contact-locking, begun as the demo "{like}".
#
#     contact-locking check {file}    says what is wrong, or what would run
#     contact-locking run {file}      solves; the results are in {directory}
#
# Units are any consistent ones; [length] and the like say which kind a number has. Keys behind
# a # are not set and show their defaults. Numbers such as (5) are those of the equations in the
# documentation, page "The problem".
"""


class _Line(NamedTuple):
    """A line of YAML, or with ``given`` False a key that is not set, and its comment."""

    depth: int
    code: str
    comment: str = ""
    given: bool = True


def names() -> list[str]:
    """The names of the demos that a file may begin as."""
    return sorted(path.stem for path in _DEMOS.glob("*.yml"))


def starter(like: str, file: str | Path) -> str:
    """The text of a study file for ``file``, with the values of a demo.

    Raises InputError for a demo that does not exist.
    """
    if like not in names():
        known = f"{nearest(like, names())}; there are {', '.join(names())}"
        raise InputError(f"--like: no demo is named {show(like)}{known}")
    demo = (_DEMOS / f"{like}.yml").resolve()
    # A tool in a file stays where the demo has it.
    data = _with_absolute_paths(read(demo).data, demo.parent)
    directory = f"results/{Path(file).stem}"
    data["output"] = {**data.get("output", {}), "directory": directory}
    shown = shlex.quote(printable(str(file), keep=""))
    head = _HEAD.format(like=like, file=shown, directory=printable(directory, keep=""))
    parts = [head, *_parts(data)]
    return "\n".join(parts)


def _with_absolute_paths(value: Any, folder: Path) -> Any:
    """The data of a study file, where the name of each file has its folder."""
    match value:
        case dict():
            return {key: _with_absolute_paths(item, folder) for key, item in value.items()}
        case list():
            return [_with_absolute_paths(item, folder) for item in value]
        case str() if (folder / value).is_file():
            return str(folder / value)
    return value


def _parts(data: Mapping[str, Any]) -> Iterator[str]:
    for name in visible_fields(Parameters):
        one = list(_section(Parameters, data, 0, True, (name,)))
        yield "".join(f"{text}\n" for line in one for text in _text(line))


def _section(
    model: type[BaseModel],
    data: Mapping[str, Any],
    depth: int,
    given: bool,
    only: tuple[str, ...] = (),
) -> Iterator[_Line]:
    """The lines of the keys of a section; ``given`` says that the section is in the file."""
    for name, field in visible_fields(model).items():
        if only and name not in only:
            continue
        path, section = section_in(field.annotation)
        about = _about(unit_of(field), field.description or "")
        value = data.get(name)
        if value is None:
            optional = field.default is None or path
            if section is None or optional:
                keys = f"; keys: {', '.join(visible_fields(section))}" if section else ""
                yield _Line(depth, f"{name}: {_flow(field.default)}", about + keys, False)
            else:
                yield _Line(depth, f"{name}:", about, False)
                yield from _section(section, {}, depth + 1, False)
        elif section is not None and isinstance(value, dict):
            yield _Line(depth, f"{name}:", about, given)
            if path:
                for entry, inner in value.items():
                    yield _Line(depth + 1, f"{_flow(entry)}:", "", given)
                    yield from _section(section, inner, depth + 2, given)
            else:
                yield from _section(section, value, depth + 1, given)
        elif section is not None and isinstance(value, list):
            yield _Line(depth, f"{name}:" if value else f"{name}: []", about, given)
            for entry in value:
                yield _Line(depth + 1, f"- {_flow(entry)}", "", given)
            for key, inner in visible_fields(section).items():
                told = _about(unit_of(inner), inner.description or "")
                yield _Line(depth + 1, "", f"{key}: {told}")
        else:
            yield _Line(depth, f"{name}: {_flow(value)}", about, given)
    if model is MeshParameters and "file" not in data:
        yield from _builder(data, depth, given)


def _builder(data: Mapping[str, Any], depth: int, given: bool) -> Iterator[_Line]:
    for entry in fields(BUILDERS[data.get("builder", "block")]):
        about = _about(entry.metadata["unit"], entry.metadata["description"])
        if entry.name in data:
            yield _Line(depth, f"{entry.name}: {_flow(data[entry.name])}", about, given)
        else:
            default = None if entry.default is MISSING else entry.default
            yield _Line(depth, f"{entry.name}: {_flow(default)}", about, False)


def _about(unit: str, description: str) -> str:
    return description if unit in ("", "1") else f"[{unit}] {description}"


def _text(line: _Line) -> list[str]:
    """The line with its comment, folded into several lines of comment if it is long."""
    indent = _INDENT * line.depth
    code = indent + ("" if line.given else "# ") + line.code
    column = max(_COMMENTS, len(code) + 2)
    if not line.comment:
        return [code]
    if column > _COMMENTS or not line.code:
        above = textwrap.wrap(line.comment, _WIDTH - len(indent) - 2)
        return [*(f"{indent}# {part}" for part in above), *([code] if line.code else [])]
    told = textwrap.wrap(line.comment, _WIDTH - column - 2)
    return [f"{code:{column}}# {told[0]}", *(f"{'':{column}}# {part}" for part in told[1:])]


def _flow(value: Any) -> str:
    match value:
        case dict():
            items = (f"{_flow(key)}: {_flow(item)}" for key, item in value.items())
            return "{" + ", ".join(items) + "}"
        case list() | tuple():
            return "[" + ", ".join(map(_flow, value)) + "]"
        case float() if math.isfinite(value):
            return f"{value:.15g}"
        case str():
            return value if _is_plain(value) else json.dumps(value, ensure_ascii=False)
    return show(value)


def _is_plain(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return bool(_PLAIN_TEXT.fullmatch(text)) and text.lower() not in _NOT_TEXT
    return False
