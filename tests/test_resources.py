"""What the jobs of a study ask a cluster for, and what they took."""

from pathlib import Path

import pytest

from brownpipe.engines import forecast
from brownpipe.study import read_study
from brownpipe.study.resources import (
    COPIES_READ,
    MOST_IN_A_SECOND_CASE,
    Need,
    cores_of_aggregate,
    describe_used,
    need_of_runs,
    needs_of_others,
    requests,
    used,
)

CONFIG = Path(__file__).parent.parent / "config"
TABLE = "s\th:m:s\tmax_rss\tcpu_time\n{}\t0:00:10\t{}\t9.0\n"


@pytest.fixture
def study():
    return read_study(CONFIG / "small.yaml", {"particles": 50, "scenes": "scenes/harrison2020.yaml"})


def test_a_job_asks_for_the_forecast_with_a_margin_and_twice_as_much_at_each_retry(study):
    asked = requests(study)["simulate"]
    wildcards = {"scene": "harrison2020", "particles": "50", "engine": "exact", "first": "0", "last": "999999"}
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
    assert text.count("benchmark:") == len(asked)
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
    assert needs_of_others(study)["replay"].memory < few.memory < needs_of_others(study)["figures"].memory


def test_two_cases_are_analysed_at_the_same_time_unless_they_are_large():
    def cores(**more):
        return cores_of_aggregate(read_study(CONFIG / "small.yaml", {"particles": 50} | more))

    assert cores() == cores(seeds=10**5, batch=10**3) == 2
    assert cores(seeds=10**6, batch=10**5) == 1  # of which each file has some 100 MB
    need = needs_of_others(read_study(CONFIG / "small.yaml"))["aggregate"]
    assert 1e6 * need.megabytes() > need.memory + MOST_IN_A_SECOND_CASE


def test_what_jobs_took_is_compared_with_what_they_ask_for(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert describe_used(study) == "no job was measured"
    tables = Path("results/small/benchmarks")
    first, second = (tables / f"simulate/harrison2020/N50/exact/{seeds}.tsv" for seeds in ("0-29", "30-59"))
    first.parent.mkdir(parents=True)
    need = need_of_runs(forecast.of_run(study.cases[0]), 30)
    first.write_text(TABLE.format(30 * need.minutes(), 0.25e6 / 2**20 * need.megabytes()))
    second.write_text(TABLE.format(0.4, "NA"))  # too short to be measured
    (tables / "aggregate").mkdir()
    (tables / "aggregate/small.tsv").write_text("s\n")
    (job,) = used(study)
    assert job.job == "simulate/harrison2020/N50/exact/0-29.h5" and job.need == need
    said = describe_used(study)
    assert said.startswith("1 jobs took 3 min, forecast ")
    assert said.endswith(" of CPU; at most 50 % of the requested time, 25 % of the requested memory")


def test_a_request_is_a_whole_number_above_the_need():
    need = Need(memory=1e9, seconds=3600.0)
    assert (need.megabytes(), need.minutes()) == (1950, 125)
    assert (need.megabytes(2), need.minutes(2)) == (3900, 250)
