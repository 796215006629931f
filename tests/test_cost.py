"""What the jobs of a study ask a cluster for."""

from pathlib import Path

import pytest

from brownpipe.engines import forecast
from brownpipe.study import read_study
from brownpipe.study.cost import requests
from brownpipe.study.run_sets import run_sets

CONFIG = Path(__file__).parent.parent / "config"


@pytest.fixture
def study():
    return read_study(CONFIG / "small.yaml", {"particles": 50, "scenes": "scenes/harrison2020.yaml"})


def test_a_job_asks_for_twice_the_forecast_and_twice_as_much_at_each_retry(study):
    asked, (runs,) = requests(study)["simulate"], run_sets(study)
    wildcards = {"digest": runs.key, "first": "0", "last": "999999"}
    cost = forecast.of_run(study.cases[0])
    expected = forecast.memory(cost, 10**6) / 1e6
    assert 2 * expected < asked["mem_mb"](wildcards, attempt=1) < 2.2 * expected
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


def test_analyses_ask_for_more_with_more_runs_quantities_and_larger_files():
    def asked(rule="aggregate", key="mem_mb", **more):
        return requests(read_study(CONFIG / "small.yaml", {"particles": 50} | more))[rule][key]({}, 1)

    assert asked() < 1500 and asked(key="runtime") < 10
    assert asked() < asked(observables=["velocity_autocorrelation"])
    assert (
        asked(seeds=10**5, batch=10**3) < asked(seeds=10**5, batch=10**4) < asked("tradeoff", seeds=10**5, batch=10**4)
    )
    assert asked("aggregate", "runtime", seeds=10**7, batch=10**5) > 60
    tolerance = {"seeds": None, "tolerance": 0.001}
    assert asked("plan", "runtime", **tolerance) < asked("tradeoff", "runtime", **tolerance)  # the pilot alone
