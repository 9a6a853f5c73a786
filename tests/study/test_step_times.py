"""The times of steps: what study files may say, and what histories and timelines keep."""

from __future__ import annotations

import numpy as np
import pytest
from problems import block
from sheared_block import all_of, sheared

from contact_locking import InputError, solve_steps
from contact_locking.process.loop import Timeline
from contact_locking.process.settings import Steps
from contact_locking.results.table import Table

pytestmark = pytest.mark.serial


def test_the_time_is_refused_without_steps() -> None:
    with pytest.raises(ValueError, match="depends on the time t, and the file has no steps"):
        block(contact__gap="0.1*t")
    loads = {"displacements": [{"on": "left", "value": ["t", 0]}]}
    with pytest.raises(ValueError, match=r"steps: \{to: 1, count: 20\}"):
        block(loads=loads)
    with pytest.raises(ValueError, match="unknown name 't'"):
        block(material__locking_limit="0.02*t", steps={"to": 1, "count": 2})


def test_steps_that_make_no_sense_are_refused() -> None:
    for to, times in ((1, [1]), (None, []), (None, [0, 1, 1])):
        with pytest.raises(InputError) as caught:
            Steps(to=to, times=times)
        assert caught.value.key == "Steps.times"
    with pytest.raises(InputError, match="give `to` and `count`"):
        Steps(to=1)


def test_a_value_that_is_not_finite_at_some_time_is_refused_with_its_key() -> None:
    loads = {"displacements": [{"on": "top", "value": [0, "-0.01/(1 - t)"]}]}
    with pytest.raises(InputError, match="finite") as caught:
        list(solve_steps(sheared(2, loads=loads)))
    assert caught.value.key == "loads.displacements.0.value.1"


def test_a_timeline_reaches_every_planned_time_whatever_fails() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        planned = [float(time) for time in np.cumsum(random.uniform(0.01, 1.0, 5))]
        timeline = Timeline(Steps(times=planned))
        most, reached, tries = random.uniform(0.1, 1.0), [], 0
        while not timeline.is_over and tries < 500:
            tries += 1
            length = timeline.target - timeline.done
            if length > most * random.uniform(0.5, 1.0):
                assert timeline.fail()
                continue
            timeline.succeed()
            reached.append(timeline.done)
        assert timeline.is_over and set(planned) <= set(reached) and reached == sorted(reached)


def test_a_history_is_read_as_it_was_written() -> None:
    history = all_of(sheared(2))[-1].history
    again = Table.read(history.text(), "history.csv")
    assert again == history and again.columns == history.columns
    with pytest.raises(InputError, match=r"history\.csv:2"):
        Table.read(history.text().replace("\n1,", "\n1,1,"), "history.csv")
