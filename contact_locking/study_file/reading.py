"""A study file: read with the line of every key, overridden, and checked with all its cases.

YAML 1.2 is read without tags, anchors and repeated keys. A study needs none of them, and without
them a small text cannot become large data or create objects.
"""

from __future__ import annotations

import contextlib
import copy
import io
import math
import os
import stat
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from contact_locking.errors import InputError, require_kind
from contact_locking.files import similar
from contact_locking.plain_text import printable
from contact_locking.study_file.dump import dump
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.study import known_keys
from contact_locking.study_file.parameters.wording import (
    REMOVED_KEYS,
    REMOVED_VALUES,
    labels,
    unknown_key,
)
from contact_locking.study_file.schema import rows
from contact_locking.values.concept import MOST_FAULTS, Fault, Place, dotted, faults_of
from contact_locking.values.value import show

# A sweep of 10 000 cases over several keys is smaller. Text that is made to take long takes 4 s.
MAX_BYTES = 300_000
MAX_DEPTH = 50
# Lengths of a message and of the key before it.
_MAX_MESSAGE, _MAX_KEY = 1000, 200
_TAG = "tag:yaml.org,2002:"
# The sections with keys on.
_WITH_ON = ("contact", "loads.")


@dataclass
class Source:
    """The data of a file with its overrides, and the origin of each key."""

    name: str
    data: Any = field(default_factory=dict)
    #: By dotted key: the line in the file, or the key of the override that set the value.
    origins: dict[str, int | str] = field(default_factory=dict)

    def explain(self, message: str, key: str) -> str:
        """The message in one line, with the line of the key or of the nearest section above it."""
        match self.origin(key):
            case int(line):
                return f"{self.name}:{line}: {message_about(message, key)}"
            case str(override) if override == key:
                return f"--set {message_about(message, key)}"
            case str(override):
                return f"--set {override}: {message_about(message, key)}"
        return f"{self.name}: {message_about(message, key)}"

    def origin(self, key: str) -> int | str | None:
        """The origin of a key, or of the nearest section above it."""
        while key and key not in self.origins:
            key = key.rpartition(".")[0]
        return self.origins.get(key)

    def set(self, override: str) -> None:
        """Apply ``dotted.key=value``, the value in YAML; indices of lists count from 0."""
        key, equals, text = override.partition("=")
        key = key.strip()
        if not equals or not all(key.split(".")):
            raise InputError(f"--set {override}: must be of the form dotted.key=value")
        origin = f"--set {key}"
        value = _Reader(origin, lines=False).read(text)
        try:
            created = assign(self.data, key, value)
        except KeyError as error:
            raise InputError(f"{origin}: {error.args[0]}") from None
        for below in [known for known in self.origins if f"{known}.".startswith(f"{key}.")]:
            del self.origins[below]
        self.origins.update(dict.fromkeys((*created, key), key))


def message_about(message: str, key: str) -> str:
    """``key: message`` in one line, with long parts shortened and control characters escaped."""
    text = _short(printable(" ".join(message.split())), _MAX_MESSAGE)
    shown = _short(key if key.isprintable() else ascii(key), _MAX_KEY)
    return f"{shown}: {text}" if key else text


def read(path: str | Path) -> Source:
    """The study file as data. Raises InputError for anything but a YAML mapping in UTF-8."""
    require_kind(path, str | os.PathLike, "the name of a study file", "path")
    path = Path(path)
    name = str(path)
    try:
        kind = path.stat().st_mode
        if stat.S_ISDIR(kind):
            raise InputError(f"{name}: is a folder; give a study file in it")
        if not stat.S_ISREG(kind):
            # Reading a pipe to which nobody writes would never end.
            raise InputError(f"{name}: is a pipe or a device; give a regular file")
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"{name}: there is no such file{similar(path)}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{name!r}: cannot be read: {reason}") from None
    if len(raw) > MAX_BYTES:
        raise InputError(f"{name}: is larger than {MAX_BYTES // 1000} kB; not a study file")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{name}:{line}: is not text in UTF-8") from None
    reader = _Reader(name, lines=True)
    data = reader.read(text)
    if data is None:
        raise InputError(
            f"{name}: is empty; 'contact-locking schema' lists the keys, "
            "and {} as its only content takes every default"
        )
    if not isinstance(data, dict):
        raise InputError(f"{name}:1: must be a mapping of keys such as mesh, material and loads")
    return Source(name, data, reader.origins)


def assign(data: Any, key: str, value: Any) -> list[str]:
    """Put a value at a dotted key, and return the sections that were created for it.

    Raises KeyError with a message if a part of the key stands for a value that has no keys.
    """
    *above, last = key.split(".")
    created = []
    for depth, name in enumerate(above):
        section = ".".join(above[: depth + 1])
        index = _index(data, name, ".".join(above[:depth]))
        if isinstance(data, dict) and data.get(index) is None:
            data[index] = {}
            created.append(section)
        data = data[index]
    data[_index(data, last, ".".join(above))] = value
    return created


def _short(text: str, length: int) -> str:
    return text if len(text) <= length else f"{text[: length - 3]}..."


def _reason(error: MarkedYAMLError) -> str:
    """The error of the reader, with the line where the faulty part of the file begins."""
    if error.problem is not None and "'\\t'" in error.problem:
        return "a line is indented by blanks, not by tabs"
    began = error.context_mark
    since = f" that begins in line {began.line + 1}" if began is not None and error.context else ""
    return "; ".join(
        clause for clause in (f"{error.context or ''}{since}", error.problem) if clause
    )


def _index(data: Any, name: str, place: str) -> Any:
    if isinstance(data, dict):
        return name
    if not isinstance(data, list):
        raise KeyError(f"'{place}' is a value, it has no '{name}'")
    if not (name.isascii() and name.isdecimal() and len(name) < 9 and int(name) < len(data)):
        entries = f"0 to {len(data) - 1}" if data else "none"
        inside = data and isinstance(data[0], dict) and not name.isdecimal()
        guess = f" (did you mean '{place}.0.{name}'?)" if inside else ""
        raise KeyError(f"'{place}' is a list with the indices {entries}, not '{name}'{guess}")
    return int(name)


class _Reader:
    """Builds plain data from the nodes of ruamel.yaml, so that no other objects are built.

    Round trip data of ruamel.yaml have lines too, but aliases and merged keys in them are resolved,
    and names such as 01 and 1e3 have become numbers.
    """

    def __init__(self, name: str, *, lines: bool) -> None:
        self.name = name
        self.lines = lines
        self.origins: dict[str, int | str] = {}
        self.seen: set[int] = set()
        self.yaml = YAML(typ="safe", pure=True)

    def read(self, text: str) -> Any:
        try:
            # ruamel.yaml writes remarks about odd directives to the terminal.
            with contextlib.redirect_stderr(io.StringIO()):
                root = self.yaml.compose(text)
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            line = mark.line + 1 if mark else None
            self.refuse(f"is not valid YAML: {_reason(error)}", line)
        except RecursionError:
            self.refuse(f"is nested more than {MAX_DEPTH} levels deep")
        except Exception as error:  # The parser may raise any exception for arbitrary text.
            reason = str(error) or repr(error)
            self.refuse(f"is not valid YAML: {reason.splitlines()[0]}")
        return None if root is None else self.data(root, "", 0)

    def data(self, node: Node, key: str, depth: int) -> Any:
        line = node.start_mark.line + 1
        if depth > MAX_DEPTH:
            self.refuse(f"is nested more than {MAX_DEPTH} levels deep", line)
        if id(node) in self.seen:
            self.refuse("anchors and aliases (& and *) are not supported; write it out", line)
        self.seen.add(id(node))
        match node:
            case ScalarNode():
                return self.scalar(node, line)
            case SequenceNode():
                self.check_tag(node, "seq", line)
                items = []
                for index, entry in enumerate(node.value):
                    below = f"{key}.{index}".lstrip(".")
                    self.remember(below, entry)
                    items.append(self.data(entry, below, depth + 1))
                return items
            case MappingNode():
                self.check_tag(node, "map", line)
                return self.mapping(node, key, depth)
        self.refuse("is not valid YAML", line)

    def mapping(self, node: MappingNode, key: str, depth: int) -> dict[str, Any]:
        entries: dict[str, Any] = {}
        for name_node, value in node.value:
            line = name_node.start_mark.line + 1
            if not isinstance(name_node, ScalarNode):
                self.refuse("a key must be a name", line)
            if name_node.tag == f"{_TAG}merge":
                self.refuse("merging (<<) is not supported; write it out", line)
            # The name as it is written, also if it looks like a number or a truth value.
            name = self.text(name_node, line)
            # Programs of YAML 1.1, such as PyYAML, write true for the key on.
            if name_node.tag == f"{_TAG}bool" and name.lower() == "true":
                name = "on" if key.startswith(_WITH_ON) else name
            below = f"{key}.{name}" if key else name
            if name in entries:
                self.refuse(f"{below}: is given twice", line)
            self.remember(below, name_node)
            entries[name] = self.data(value, below, depth + 1)
        return entries

    def scalar(self, node: ScalarNode, line: int) -> Any:
        text = self.text(node, line)
        tag = str(node.tag).removeprefix(_TAG)
        if tag in ("str", "timestamp", "value"):
            return text
        if tag not in ("null", "bool", "int", "float"):
            self.refuse(f"tags such as {str(node.tag)[:40]} are not supported", line)
        try:
            value = self.yaml.constructor.construct_object(node)
        except (ValueError, KeyError, IndexError):
            self.refuse(f"'{text[:40]}' cannot be read as {tag}", line)
        if isinstance(value, float) and math.isinf(value) and "inf" not in text.lower():
            self.refuse(f"'{text[:40]}' is too large; infinity is written .inf", line)
        return value

    def text(self, node: ScalarNode, line: int) -> str:
        text = str(node.value)
        try:
            text.encode()
        except UnicodeEncodeError:
            self.refuse("contains an escape that is no character", line)
        return text

    def check_tag(self, node: Node, expected: str, line: int) -> None:
        if node.tag != f"{_TAG}{expected}":
            self.refuse(f"tags such as {str(node.tag)[:40]} are not supported", line)

    def remember(self, key: str, node: Node) -> None:
        self.origins[key] = node.start_mark.line + 1

    def refuse(self, message: str, line: int | None = None) -> NoReturn:
        place = f"{self.name}:{line}" if self.lines and line else self.name
        raise InputError(f"{place}: {' '.join(message.split())}")


def _message(details: Any, place: Place) -> str | None:
    """The message for an error at a key, if it is not that of the value alone."""
    shown = show(details["input"])
    gone = (REMOVED_VALUES.get((str(key), str(details["input"]))) for key in details["loc"])
    if instead := next(filter(None, gone), None):
        return instead
    match details["type"]:
        # A key without a value comes of a decimal comma: {gap: 0,1}.
        case "extra_forbidden" if (
            place[:-1] == ("contact",)
            and str(place[-1]).isdecimal()
            and details["input"] is not None
        ):
            return "contact is one section and not a list: leave the number out of the key"
        case "extra_forbidden" if instead := REMOVED_KEYS.get(dotted(*place)):
            return f"unknown key ({instead})"
        case "extra_forbidden":
            known = known_keys(Parameters, place[:-1])
            return unknown_key(str(place[-1]), known, _elsewhere(str(place[-1])))
        case "model_type" | "model_attributes_type" | "dict_type":
            keys = ", ".join(known_keys(Parameters, place))
            several = ", or a list of such mappings" if place == ("contact",) else ""
            with_keys = f" with keys among {keys}" if keys else ""
            return f"must be a mapping{with_keys}{several}, not {shown}"
    return None


def _elsewhere(name: str) -> str:
    """The hint at a key of another section with this name."""
    # A key in an entry of a list or a mapping is no single key of the file.
    keys = [row.key for row in rows() if "INDEX" not in row.key and "NAME" not in row.key]
    matches = [key for key in keys if key.rpartition(".")[2] == name]
    return f" (did you mean '{matches[0]}'?)" if matches else ""


# To check as many takes some 20 s; a file of the demos has 50 values.
_MOST_VALUES = 2_000_000
# The dump of a shorter file, with every default, stays below the size that can be read again.
_SHORT = MAX_BYTES // 20
_MORE = f"there may be more that is wrong; these are the first {MOST_FAULTS} faults"


@dataclass(frozen=True)
class StudyFile:
    """The parameters of a file, and its lines for the messages of errors that are found later."""

    parameters: Parameters
    source: Source

    def explain(self, error: InputError) -> str:
        """The message of an error, with file, line and key if the error has a key."""
        return self.source.explain(str(error), error.key) if error.key else str(error)

    def case(self, values: Mapping[str, Any]) -> Parameters:
        """The parameters of a case: the file without its study, with ``values`` by dotted key.

        Raises InputError for values that do not fit. `load` has checked those of the file's
        own study.
        """
        return from_mapping(_with_values(self.source.data, values), Path(self.source.name).parent)


def load(path: str | Path, overrides: Sequence[str] = ()) -> StudyFile:
    """Read and check a study file, with ``overrides`` such as ``penalty.n=1e6`` applied to it.

    Paths in the file are relative to its folder; without ``output.directory`` the results go to
    ``results/`` and the name of the file, in the current folder. Raises InputError with one line
    for each fault: ``FILE:LINE: key: what was given, what is allowed``.
    """
    source = read(path)
    for override in overrides:
        source.set(override)
    parameters, faults = _check(source.data, Path(path).parent)
    if parameters is None:
        keyed = [(_key(fault), fault.message) for fault in faults]
        origins = {key: source.origin(key) for key, _ in keyed}
        keyed.sort(key=lambda fault: line if isinstance(line := origins[fault[0]], int) else 0)
        lines = [source.explain(message, key) for key, message in keyed]
        raise InputError(_listed(lines, source.explain(_MORE, "")))
    size = Path(path).stat().st_size + sum(map(len, overrides))
    if size > _SHORT and len(dump(parameters)) > MAX_BYTES:
        what = f"with every default written out, is larger than {MAX_BYTES // 1000} kB"
        raise InputError(source.explain(what, ""))
    if "directory" not in parameters.output.model_fields_set:
        output = parameters.output.model_copy(update={"directory": f"results/{Path(path).stem}"})
        parameters = parameters.model_copy(update={"output": output})
    return StudyFile(parameters, source)


def require_parameters(parameters: object) -> None:
    """Raise InputError for what are no parameters of a study, such as the name of its file."""
    require_kind(
        parameters, Parameters, "parameters, as load('study.yml').parameters", "parameters"
    )


def from_mapping(data: Mapping[str, Any], folder: str | Path = ".") -> Parameters:
    """The parameters of a study file that is given as a mapping, for Python scripts.

    Raises InputError with one line for each fault: ``key: what was given, what is allowed``.
    """
    require_kind(data, Mapping, "a mapping of keys such as mesh and loads", "data")
    parameters, faults = _check(_with_on(data), Path(folder))
    if parameters is None:
        lines = [message_about(fault.message, _key(fault)) for fault in faults]
        raise InputError(_listed(lines, _MORE))
    return parameters


def _with_on(data: Any) -> Any:
    """The data with the key on where PyYAML, which reads YAML 1.1, has the key True."""
    if isinstance(data, Mapping):
        return {"on" if key is True else key: _with_on(value) for key, value in data.items()}
    return [_with_on(value) for value in data] if isinstance(data, list | tuple) else data


def _key(fault: Fault) -> str:
    return ".".join(str(name) or "''" for name in fault.place)


def _listed(lines: list[str], ending: str) -> str:
    """One line for each fault, and after `MOST_FAULTS` of them that there may be more."""
    return "\n".join(lines if len(lines) < MOST_FAULTS else [*lines[:MOST_FAULTS], ending])


def _check(data: dict[str, Any], folder: Path) -> tuple[Parameters | None, list[Fault]]:
    """The parameters, or the faults of the file and of all cases of its study."""
    parameters, faults = _validate(data, folder)
    if parameters is None or parameters.study is None:
        return parameters, faults
    cases = parameters.study.cases()
    if fault := _too_much(data, cases):
        return None, [fault]
    wrong: dict[str, list[str]] = {}
    for case, shown in zip(cases, labels(cases), strict=True):
        try:
            _, faults = _validate(_with_values(data, case), folder)
        except KeyError as error:
            faults = [Fault((), error.args[0])]
        # An unknown key is often what another one is missing for.
        unknown = [fault for fault in faults if fault.message.startswith("unknown key")]
        for fault in unknown or faults:
            text = message_about(fault.message, _key(fault)) if fault.place else fault.message
            wrong.setdefault(text, []).append(shown)
    if wrong:
        listed = []
        for text, (first, *others) in wrong.items():
            count = f" and {len(others)} other{'s' * (len(others) > 1)}" if others else ""
            listed.append(Fault(("study",), f"in the case {first}{count}: {text}"))
        return None, listed[:MOST_FAULTS]
    return parameters, []


def _too_much(data: dict[str, Any], cases: Sequence[Mapping[str, Any]]) -> Fault | None:
    """The fault of a study that would take minutes to check, as each case is a copy of the file."""
    size = sum(_size(value) for key, value in data.items() if key != "study")
    size += max((_size(value) for case in cases for value in case.values()), default=0)
    if len(cases) * size <= _MOST_VALUES:
        return None
    message = f"has {len(cases)} cases of {size} values each; at most {_MOST_VALUES} are allowed"
    return Fault(("study",), f"{message} in all")


def _size(value: Any) -> int:
    if isinstance(value, dict | list | tuple):
        return 1 + sum(map(_size, value.values() if isinstance(value, dict) else value))
    return 1


def _with_values(data: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    changed = copy.deepcopy({key: value for key, value in data.items() if key != "study"})
    for key, value in values.items():
        assign(changed, key, copy.deepcopy(value))
    return changed


def _validate(data: dict[str, Any], folder: Path) -> tuple[Parameters | None, list[Fault]]:
    try:
        return Parameters.model_validate(data, context=folder), []
    except ValidationError as error:
        return None, faults_of(error, _message)
