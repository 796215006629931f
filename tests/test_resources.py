"""What the jobs of a study ask a cluster for."""

from pathlib import Path

import pytest

from brownpipe.engines import forecast
from brownpipe.study import read_study
from brownpipe.study.resources import COPIES_READ, Need, needs_of_others, requests
from brownpipe.study.run_sets import run_sets

CONFIG = Path(__file__).parent.parent / "config"


@pytest.fixture
def study():
    return read_study(CONFIG / "small.yaml", {"particles": 50, "scenes": "scenes/harrison2020.yaml"})


def test_a_job_asks_for_the_forecast_with_a_margin_and_twice_as_much_at_each_retry(study):
    asked, (runs,) = requests(study)["simulate"], run_sets(study)
    wildcards = {"digest": runs.key, "first": "0", "last": "999999"}
    cost = forecast.of_run(study.cases[0])
    expected = forecast.memory(cost, 10**6) / 1e6
    assert 1.5 * expected < asked["mem_mb"](wildcards, attempt=1) < 1.6 * expected
    minutes = 10**6 * (cost.seconds + cost.storing) / 60
    assert 2 * minutes < asked["runtime"](wildcards, attempt=1) < 2 * minutes + 10
    for key in ("mem_mb", "runtime"):
        assert asked[key](wildcards, attempt=3) == 4 * asked[key](wildcards, attempt=1)
    assert asked["cpus_per_task"] == 1
    assert asked["mem_mb"](wildcards | {"last": "9"}, attempt=1) < 700


def test_every_rule_with_a_command_asks():
    text = "".join(file.read_text() for file in (CONFIG.parent / "workflow" / "rules").iterdir())
    asked = requests(read_study(CONFIG / "small.yaml"))
    assert [text.count(f'**request["{rule}"],') for rule in asked] == [1] * len(asked)


def test_the_need_of_the_analysis_grows_with_runs_quantities_and_the_size_of_files(study):
    def need(**more):
        return needs_of_others(read_study(CONFIG / "small.yaml", {"particles": 50} | more))["aggregate"]

    few, many, in_larger_files = need(), need(seeds=10**5, batch=10**3), need(seeds=10**5, batch=10**4)
    for more in (many, need(observables=["velocity_autocorrelation"])):
        assert more.memory > few.memory and more.seconds > few.seconds
    file = 1000 * forecast.of_run(study.cases[0]).kept
    assert in_larger_files.memory == pytest.approx(many.memory + COPIES_READ * 9 * file)
    assert in_larger_files.seconds < many.seconds
    few = needs_of_others(study)["aggregate"]
    assert few.memory < needs_of_others(study)["figures"].memory


def test_a_request_is_a_whole_number_above_the_need():
    need = Need(memory=1e9, seconds=3600.0)
    assert (need.megabytes(), need.minutes()) == (1950, 125)
    assert (need.megabytes(2), need.minutes(2)) == (3900, 250)
