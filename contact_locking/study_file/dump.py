"""Parameters as YAML, with every default written out that is not null."""

from __future__ import annotations

import io
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq

from contact_locking.results.names import HEADER
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.mesh import MeshParameters
from contact_locking.values.concept import ONLY, Concept
from contact_locking.values.value import Value


def dump(parameters: Parameters) -> str:
    """A study file that loads back to equal parameters."""
    yaml = YAML(pure=True)
    # ruamel.yaml changes blanks when it folds long text, and unusual line ends unless escaped.
    yaml.width = 2**20
    yaml.allow_unicode = False
    yaml.representer.add_representer(
        type(None), lambda writer, _: writer.represent_scalar("tag:yaml.org,2002:null", "null")
    )
    stream = io.StringIO()
    stream.write(HEADER)
    yaml.dump(plain(parameters), stream)
    return stream.getvalue()


def plain(value: Any) -> Any:
    """Parameters as nested mappings and lists, with every default."""
    match value:
        case Value():
            return value.data
        case MeshParameters():
            return {key: plain(item) for key, item in value.model_dump().items()}
        case Concept():
            fields = type(value).model_fields.items()
            given = {
                value.key_of(name): getattr(value, name)
                for name, field in fields
                if not field.exclude
            }
            if ONLY in given:
                return plain(given[ONLY])
            return {key: plain(item) for key, item in given.items() if item is not None}
        case dict():
            return {key: plain(item) for key, item in value.items()}
        case list() | tuple():
            items = CommentedSeq(plain(item) for item in value)
            if not any(isinstance(item, dict) for item in items):
                items.fa.set_flow_style()
            return items
    return value
