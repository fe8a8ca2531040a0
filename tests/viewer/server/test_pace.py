"""Tests of the pace of a flight, on a clock of their own."""

import pytest

from thalweg.viewer.server.pace import MOST_STEPS, Pace


def moving(speed: float | None, step_s: float = 0.25) -> Pace:
    pace = Pace(step_s)
    pace.go(100.0, speed)
    return pace


@pytest.mark.parametrize(("speed", "steps"), [(1.0, 4), (2.0, 8), (0.5, 2)])
def test_a_second_has_as_many_steps_as_the_speed_says(speed: float, steps: int):
    pace = moving(speed)
    assert pace.steps_due(100.0) == 1  # the first one at once
    assert sum(pace.steps_due(100.0 + 0.05 * frame) for frame in range(1, 21)) == steps


def test_the_camera_is_on_its_way_through_the_last_step():
    pace = moving(1.0)
    pace.steps_due(100.0)
    assert [pace.share(100.0 + seconds) for seconds in (0.0, 0.125, 0.25, 9.0)] == pytest.approx([0.0, 0.5, 1.0, 1.0])


def test_a_flight_that_lags_slows_down_instead_of_catching_up():
    pace = moving(1.0)
    pace.steps_due(100.0)
    assert pace.steps_due(110.0) == MOST_STEPS
    assert pace.steps_due(110.2) == 0
    assert pace.steps_due(110.25) == 1


def test_the_fastest_flight_takes_a_step_for_each_frame():
    pace = moving(None)
    assert [pace.steps_due(100.0), pace.steps_due(100.001)] == [1, 1]
    assert pace.share(100.001) == 1.0


def test_a_flight_stands_until_it_is_let_go():
    pace = Pace(0.25)
    assert (pace.moving, pace.steps_due(100.0), pace.share(100.0)) == (False, 0, 1.0)
    pace.go(100.0, 1.0)
    pace.stand()
    assert (pace.moving, pace.steps_due(101.0)) == (False, 0)


def test_another_speed_does_not_make_a_step_due():
    pace = moving(1.0)
    pace.steps_due(100.0)
    pace.go(100.1, 2.0)
    assert pace.steps_due(100.11) == 0
    assert pace.steps_due(100.13) == 1
