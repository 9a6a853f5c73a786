"""The study file of a block, and the message with which a file is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from contact_locking.errors import InputError
from contact_locking.study_file import load

BLOCK = """\
title: Block pressed and dragged on a rigid foundation
mesh:
  builder: block
  dim: 2
  size: [1.0, 1.0]
  h: 0.05
material:
  elasticity: {young: 1.0, poisson: 0.3}
  locking_limit: 0.02
loads:
  body_force: [0, 0]
  tractions: [{on: top, value: [0.03, -0.05]}]
  displacements:
    - on: left
      value: [0, null]
contact:
  on: bottom
  foundation: {half_space: {point: [0, 0], normal: [0, 1]}}
friction:
  coefficient: 0.3 + 0.1*exp(-s)
  smoothing: {kernel: convolution, radius: 0.1}
penalty:
  n: 1.0e4
  epsilon: null
solver: {method: auto, petsc: {snes_monitor: null}}
study:
  vary: {penalty.n: [1.0e2, 1.0e4, .inf]}
output: {directory: results/block, fields: true, picture: true}
"""


def refusal(path: Path, content: str | bytes, *overrides: str) -> str:
    """The message with which the content is refused, the file's path shortened to FILE."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(InputError) as caught:
        load(path, overrides)
    return str(caught.value).replace(str(path), "FILE")
