"""What counts as a change: numbers drawn here, with the errors that the test assumes."""

import math

import numpy as np
import pytest
from tendril.watch.change import DAY_s, changes, onsets, threshold
from tendril.watch.store import Entry, Key, Number

DEVIATION = 1.0
KEYS = [Key("cell_offset", f"tendon:{j}", "N") for j in range(1, 9)]


def entry(at, values, material=2.0):
    numbers = {
        key: Number("N", float(value), DEVIATION, material) for key, value in zip(KEYS, values, strict=True)
    }
    return Entry("robot", at * DAY_s, numbers, {})


def robot(rng, days, course=lambda day: 0.0, material=2.0):
    """An accepted state and days of a robot whose first number has this course."""

    def noisy(day):
        values = rng.normal(0, DEVIATION, len(KEYS))
        values[0] += course(day)
        return entry(day, values, material)

    accepted = entry(0, rng.normal(0, DEVIATION, len(KEYS)), material)
    return accepted, [noisy(day) for day in range(1, days + 1)]


def first_found(accepted, days, rate=0.5, alarm=False):
    for count in range(1, len(days) + 1):
        found = changes(accepted, days[:count], rate)
        if any(change.alarm or not alarm for change in found):
            return count, found
    return None, []


def test_no_more_false_alarms_than_asked_for_and_not_far_fewer():
    """The rate that is asked for is a bound; far below it, changes would be found late."""
    rng, days, rate, alarms = np.random.default_rng(1), 60, 60.0, 0
    for _ in range(6):
        accepted, course = robot(rng, days)
        alarms += sum(bool(changes(accepted, course[: n + 1], rate)) for n in range(days))
    asked_for = rate / 365 * 6 * days
    assert 0.15 * asked_for < alarms < asked_for + 3 * math.sqrt(asked_for)


def test_a_large_step_is_found_at_once_with_its_size_and_day():
    accepted, days = robot(np.random.default_rng(2), 20, lambda day: 12.0 if day > 10 else 0.0)
    count, found = first_found(accepted, days)
    assert count == 11 and found[0].key == KEYS[0] and found[0].alarm
    later = changes(accepted, days, 0.5)[0]
    assert later.shape == "step" and later.since == 11 * DAY_s
    assert later.ci[0] < 12.0 < later.ci[1]


def test_a_drift_far_below_materiality_a_day_is_found_against_the_accepted_state():
    """A tenth of a deviation a day is not to be seen from one day to the next."""
    accepted, days = robot(np.random.default_rng(7), 80, lambda day: 0.1 * max(day - 20, 0), material=3.0)
    count, _ = first_found(accepted, days)
    assert 20 < count < 80
    last = changes(accepted, days, 0.5)[0]
    assert last.key == KEYS[0] and last.shape == "drift" and last.alarm
    assert last.per_day == pytest.approx(0.1, rel=0.4)
    assert last.since == pytest.approx(20 * DAY_s, abs=12 * DAY_s)


def test_a_sure_change_that_does_not_matter_is_no_alarm():
    accepted, days = robot(np.random.default_rng(4), 12, lambda day: 12.0, material=20.0)
    found = changes(accepted, days, 0.5)
    assert found and not found[0].alarm


def test_the_error_of_the_accepted_value_is_no_change_however_many_days_confirm_it():
    """Days whose own errors are nothing beside it."""
    accepted = entry(0, [3.0] + [0.0] * 7)
    precise = {key: Number("N", 0.0, 0.001, 0.5) for key in KEYS}
    days = [Entry("robot", day * DAY_s, precise, {}) for day in range(1, 60)]
    assert not changes(accepted, days, 0.5)


def test_days_that_scatter_beyond_their_intervals_are_taken_as_they_are():
    """Three times as far apart as they say: without their scatter there would be an alarm."""
    rng = np.random.default_rng(5)
    accepted = entry(0, [0.0] * 8)
    days = [entry(day, rng.normal(0, 3 * DEVIATION, 8)) for day in range(1, 60)]
    quiet = sum(bool(changes(accepted, days[: n + 1], 0.5)) for n in range(12, 59))
    assert quiet <= 2
    shifted = [entry(day, rng.normal(0, 3 * DEVIATION, 8) + 15) for day in range(60, 70)]
    assert changes(accepted, [*days, *shifted], 0.5)


def test_a_number_that_a_day_does_not_have_is_not_judged_on_it():
    accepted, days = robot(np.random.default_rng(6), 3, lambda day: 50.0)
    days[-1].numbers.pop(KEYS[0])
    assert KEYS[0] not in [change.key for change in changes(accepted, days, 0.5)]


def test_entries_of_the_same_time_are_no_division_by_nothing():
    accepted = entry(1, [0.0] * 8)
    days = [entry(1, [20.0] + [0.0] * 7)] * 4
    assert changes(accepted, days, 0.5)[0].amount == pytest.approx(20)


def test_onsets_double_and_the_threshold_rises_with_what_is_tried():
    assert onsets(1) == [0] and onsets(5) == [0, 1, 3, 4] and onsets(8) == [0, 4, 6, 7]
    assert threshold(1, 1, 0.5) < threshold(100, 1, 0.5) < threshold(100, 300, 0.5) < 6
    assert threshold(100, 1, 5) < threshold(100, 1, 0.5)
