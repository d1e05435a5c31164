"""Clocks that jump and positions that cannot be are not used; late lines are not taken for a clock."""

import pytest

from eadp.live.gate import CLOCK, FROZEN_S, MIN_AGREEING, MIN_BACK, OutlierGate
from eadp.planning.base import Sample

SPEED = 15.0


def accepted(*pairs):
    """Whether samples of (time, x) are used, and what is odd about them."""
    gate, answers = OutlierGate(15.0), []
    for time_s, x in pairs:
        sample = Sample(time_s, (x, 0.0), None, 0.5)
        usable, notices = gate.accept(sample)
        said = "; ".join(notice.message for notice in notices)
        answers.append((usable is not None and usable.position_m is not None, said or None))
    return answers


def test_late_lines_and_duplicates_are_not_used():
    answers = accepted((1, 0), (2, 15), (2, 15), (1.5, 8), (3, 30))
    assert answers[:2] == [(True, None)] * 2
    assert answers[2] == (False, "late: 2 s is not after 2 s")
    assert answers[3] == (False, "late: 1.5 s is not after 2 s")
    assert answers[4] == (True, None)


def test_gaps_give_a_notice_and_a_slow_stream_has_none():
    assert [message for _, message in accepted((0, 0), (1, 15), (9, 100))] == [None, None, "a gap of 8 s"]
    assert [message for _, message in accepted((0, 0), (8, 100), (16, 200))] == [None, "a gap of 8 s", None]


def test_a_gap_and_a_position_that_cannot_be_are_both_said():
    assert accepted((0, 0), (1, 15), (9, 9000))[2] == (
        False,
        "a gap of 8 s; 8985 m from the last line's position, 8 s before",
    )


def test_outliers_are_not_used_unless_they_stay():
    used = [usable for usable, _ in accepted((0, 0), (1, 9000), (2, 30), (3, 9000), (4, 60))]
    assert used == [True, False, True, False, True]
    far = accepted((0, 0), *((k, 9000 + 15 * k) for k in range(1, 5)))
    assert [usable for usable, _ in far] == [True] + [False] * (MIN_AGREEING - 1) + [True, True]
    assert "m from the last line's position" in far[1][1]
    clock = accepted((0, 0), (9e9, 0), (1, 15), (9e9, 0), (9e9 + 1, 15), (9e9 + 2, 30), (9e9 + 3, 45))
    assert [usable for usable, _ in clock] == [True, False, True, False, False, True, True]


def flown(times, positions=None, socs=None, **known):
    """What the gate makes of samples along x at cruise speed."""
    gate = OutlierGate(SPEED)
    positions = positions or [SPEED * k for k in range(len(times))]
    socs = socs or [0.9] * len(times)
    samples = [
        Sample(time_s, (x, 0.0), 36.0, soc)._replace(**known)
        for time_s, x, soc in zip(times, positions, socs, strict=True)
    ]
    return [gate.accept(sample)[0] for sample in samples]


@pytest.mark.parametrize("by_s", [7200.0, 1e9, -50.0, -1e9])
def test_a_clock_that_jumps_is_followed_by_the_usual_steps(by_s):
    used, needed = flown([*range(10), *(10 + by_s + k for k in range(15))]), MIN_AGREEING if by_s > 0 else MIN_BACK
    assert [sample.time_s for sample in used[:10]] == list(range(10))
    assert used[10 : 10 + needed - 1] == [None] * (needed - 1)
    assert [sample.time_s for sample in used[9 + needed :]] == pytest.approx(range(9 + needed, 25))
    assert [sample.warnings for sample in used[9 + needed :]] == [(CLOCK,), *[()] * (15 - needed)]


def test_late_lines_in_a_row_and_a_gap_are_none_of_the_clock():
    """A buffer that is sent after a newer line: its positions are those of its times."""
    times = [*range(10), 40, *range(10, 18), 41]
    used = flown(times, [SPEED * time_s for time_s in times])
    assert [sample and sample.time_s for sample in used] == [*range(10), 40, *[None] * 8, 41]
    gap = [*range(10), *range(40, 45)]
    assert [sample.time_s for sample in flown(gap, [SPEED * time_s for time_s in gap])] == gap


def test_a_clock_that_starts_again_elsewhere_is_followed_in_the_end():
    used = flown([*range(100, 110), *range(20)], [SPEED * k for k in (*range(10), *range(30, 50))])
    assert [sample is None for sample in used[10:]] == [True] * (MIN_BACK - 1) + [False] * (21 - MIN_BACK)
    # 29 steps of the way have been flown since the last sample before, plus nine
    assert used[9 + MIN_BACK].time_s == pytest.approx(109 + 30, abs=0.1)


def test_a_position_that_does_not_move_is_frozen():
    still = [*(SPEED * k for k in range(10)), *[SPEED * 9] * 10, SPEED * 20]
    used = flown(list(range(21)), still)
    frozen = [sample.position_m is None for sample in used]
    assert frozen == [False] * (10 + int(FROZEN_S)) + [True] * (10 - int(FROZEN_S)) + [False]
    messages = [message for _, message in accepted(*enumerate(still)) if message]
    assert messages == [f"the position has not changed for {FROZEN_S + 1:g} s"]
    # before take-off it is not, nor where the ground velocity is measured to be none
    assert all(sample.position_m is not None for sample in flown(list(range(20)), [0.0] * 20))
    assert all(sample.position_m is not None for sample in flown(list(range(20)), still[:20], velocity_mps=(0.1, 0.0)))


def test_a_position_that_comes_seldom_is_not_frozen():
    """Five lines a second, and a position a second."""
    used = flown([k / 5 for k in range(50)], [SPEED * (k // 5) for k in range(50)])
    assert all(sample.position_m is not None for sample in used)
