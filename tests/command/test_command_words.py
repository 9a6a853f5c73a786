"""The words of a command line: options of PETSc, several settings, and words that are wrong."""

from __future__ import annotations

import pytest

from contact_locking.command import cli
from contact_locking.errors import InputError

pytestmark = pytest.mark.serial


def test_petsc_options_are_pairs_or_flags() -> None:
    words = ["-a", "-1e-3", "-b", "--c", "value"]
    assert cli.petsc_options(words) == {"a": "-1e-3", "b": None, "c": "value"}
    for wrong in (["value"], ["-a", "1", "2"]):
        with pytest.raises(InputError, match="begin with a dash"):
            cli.petsc_options(wrong)


@pytest.mark.parametrize(
    "words", [[], ["solve"], ["run"], ["run", "a", "b"], ["schema", "--", "-x"], ["mesh", "a"]]
)
def test_wrong_words_return_2_with_one_message(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(words) == 2
    assert capsys.readouterr().err.startswith("error: ")
