"""Forecasts of the time of a run: the work of a trial is counted, by a clock that advances with it."""

import numpy as np
import pytest

from dynid.errors import DynidError
from dynid.scene.explanation import Report, forecast, trial
from dynid.scene.load import load_scene


class Work:
    """A clock that advances by one second for each time it is read."""

    def __init__(self):
        self.seconds = 0

    def __call__(self):
        self.seconds += 1
        return float(self.seconds)


@pytest.fixture
def scene(request):
    return load_scene(request.config.rootpath / "configs" / "table1.yaml")


def test_a_run_that_ends_within_the_limit_is_measured(scene):
    clock = Work()
    cost = trial(scene, limit=1000, clock=clock)
    assert cost.source == "measured by a trial run"
    assert cost.kilobytes > 10
    # every report reads the clock once, and so do beginning and end
    assert cost.seconds == clock.seconds - 1


def test_a_run_beyond_the_limit_is_cut_off_and_extrapolated(scene):
    clock = Work()
    cost = trial(scene, limit=3, clock=clock)
    assert cost.source == "from the beginning of a trial run"
    assert cost.kilobytes is None
    assert clock.seconds == 5
    assert cost.seconds > 3


def test_the_forecast_of_a_trial_that_is_cut_off_is_right_within_a_factor_of_two_of_its_work(scene):
    whole = trial(scene, limit=1e9, clock=Work()).seconds
    cost = trial(scene, limit=whole - 2, clock=Work())
    assert cost.kilobytes is None
    assert whole / 2 <= cost.seconds <= 40 + whole  # the steps of an attempt whose end is not known


def test_a_run_that_fails_has_no_forecast(scene, monkeypatch):
    def fails(_):
        raise DynidError("no", remedy="")

    monkeypatch.setattr("dynid.scene.run.run_scene", fails)
    with pytest.raises(DynidError, match="no"):
        trial(scene)


def reports(*parts):
    """Reports from pairs of a text and the time until the next."""
    times = np.cumsum([0.0, *(duration for _, duration in parts)])
    return [Report(what, float(at)) for (what, _), at in zip([*parts, ("", 0)], times, strict=True)]


STEP = ("maximum likelihood, step 1", 2.0)


def test_steps_of_an_attempt_are_extrapolated_to_those_of_a_run():
    assert forecast(reports(("the start", 1.0), *10 * [STEP])) == 21 + 30 * 2.0


def test_blocks_of_samples_belong_to_their_step():
    blocks = [("maximum likelihood, step 1", 0.5), *3 * [("sensitivities, block 1", 0.5)]]
    assert forecast(reports(("the start", 1.0), *10 * blocks)) == 21 + 30 * 2.0


def test_starts_are_ranked_before_a_search():
    ranked = [(f"start {k} of 256", 0.5) for k in range(1, 11)]
    assert forecast(reports(STEP, *ranked)) == 2 + 5 + 246 * 0.5 + 6 * 40 * 2.0


def test_attempts_of_a_search_are_extrapolated_from_those_made():
    ranked = [(f"start {k} of 4", 0.5) for k in range(1, 5)]
    attempts = [("start 1 of 4", 0.0), *5 * [STEP], ("start 2 of 4", 0.0), *5 * [STEP]]
    assert forecast(reports(STEP, *ranked, *attempts)) == 2 + 2 + 20 + 4 * 10.0
