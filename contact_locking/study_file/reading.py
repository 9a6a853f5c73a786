"""Load a study file: read it, override values, check it and all cases of its study."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from contact_locking.errors import InputError, require_kind
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
from contact_locking.study_file.source import MAX_BYTES, Source, assign, read, tell
from contact_locking.values.concept import MOST_FAULTS, Fault, Place, dotted, faults_of
from contact_locking.values.value import show


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
        lines = [tell(fault.message, _key(fault)) for fault in faults]
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
            text = tell(fault.message, _key(fault)) if fault.place else fault.message
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
