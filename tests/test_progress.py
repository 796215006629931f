"""How much of a long calculation is done: what is reported, and what a terminal or a log shows of it."""

import os
import re
import signal
import struct
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import pytest

from brownpipe import analysis, progress, stages, tradeoff
from brownpipe.engines import configured, placement
from brownpipe.engines.exact import run as exact_run
from brownpipe.engines.initial_state import draw
from brownpipe.engines.timestep import simulation as timestep
from brownpipe.figures.movie import movie
from brownpipe.stages import Stage
from brownpipe.storage import read_trajectories, write_trajectories
from brownpipe.study import plan
from synthetic import render
from test_exact import P, box, make

SCENE = make(box(6, 6, P), [(1, 0.6, 9), (30, 0.25, 1)], 4.0).replace(equilibrate=4.0)
EXACT, STEPS = configured("exact"), configured("timestep", time_step=0.01)


@pytest.fixture
def reported():
    """The stages that are reported during the test."""
    found = []
    stages.listeners.append(found.append)
    yield found
    stages.listeners.remove(found.append)


# -- what is reported -----------------------------------------------------------------------------------------------


def test_a_piece_is_reported_by_what_is_tracked_within_it_and_by_nothing_else(reported):
    for _ in stages.tracked("ab", "cases"):
        stages.report("runs", 1, 3)
        for _ in stages.tracked("cd", "engines"):
            stages.report("runs", 2, 3)
    shares = [0, 0, 0.5, 0.5, 1, 1]  # of a case: two reports within it and its engines, after each engine, at its end
    assert reported == [Stage("cases", case + share, 2) for case in (0, 1) for share in shares]


def test_stages_can_be_renamed_and_left_out(reported):
    with stages.counted_as("runs before"):
        stages.report("runs", 1, 8)
    with stages.unreported():
        stages.report("runs", 2, 8)
    assert reported == [Stage("runs before", 1, 8)]


def shares(reported, runs):
    """The fractions of a batch that were reported, which must never fall."""
    assert {(stage.unit, stage.total) for stage in reported} == {("runs", runs)}
    done = [stage.done for stage in reported]
    assert done == sorted(done)
    return done


@pytest.mark.parametrize("engine", [EXACT, STEPS], ids=lambda engine: engine.name)
def test_a_run_is_reported_by_simulated_time_and_stays_the_same(engine, monkeypatch):
    before = engine.simulate(SCENE, [3, 4], {"tracer"}).tracer.position
    monkeypatch.setattr(exact_run, "EVENTS_PER_CALL", 60)
    monkeypatch.setattr(timestep, "DISK_STEPS_PER_CALL", 31 * 39)
    found = []
    monkeypatch.setattr(stages, "listeners", [found.append])
    after = engine.simulate(SCENE, [3, 4], {"tracer"}).tracer.position
    assert after.tobytes() == before.tobytes()
    done = np.array(shares(found, 2))
    inside = done % 1
    assert np.count_nonzero((inside > 0) & (inside < 0.5)) > 2 < np.count_nonzero(inside > 0.5)  # half equilibrates
    assert {1.0, 2.0} <= set(done) and done[0] < 0.2


def test_the_placement_of_many_disks_is_reported_and_stays_the_same(reported, monkeypatch):
    before = draw(SCENE, 0).position
    assert reported == []
    monkeypatch.setattr(placement, "TRIES_PER_CALL", 8)
    assert draw(SCENE, 0).position.tobytes() == before.tobytes()
    assert {(stage.unit, stage.total) for stage in reported} == {("disks placed", 31)}
    done = [stage.done for stage in reported]
    assert done == sorted(done) and len(done) > 2


def test_runs_that_measure_a_friction_are_no_runs_of_the_batch(reported):
    engine = configured("langevin", friction="measured")
    engine.simulate(SCENE, [0, 1, 2], {"tracer"})
    runs = [stage for stage in reported if stage.unit == "runs"]
    assert runs == [Stage("runs", k, 3) for k in (1, 2, 3)]
    others = [stage for stage in reported if stage.unit != "runs"]
    assert others[-1] == Stage("runs that measure the friction", 8, 8)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Trajectory files of two engines, the first one with a whole run."""
    folder = tmp_path_factory.mktemp("files")
    for name, engine, record in (("exact", EXACT, {"tracer", "all"}), ("steps", STEPS, {"tracer"})):
        ensemble = engine.simulate(SCENE, range(12), record)
        write_trajectories(folder / f"{name}.h5", SCENE, engine, ensemble)
    return [folder / "exact.h5", folder / "steps.h5"]


@pytest.mark.slow
def test_analysis_reports_files_and_then_runs(files, reported, tmp_path):
    dataset = analysis.aggregate(files, [(0.2, 1.0)])
    assert reported[:2] == [Stage("files verified", 1, 2), Stage("files verified", 2, 2)]
    assert reported[2:] == [Stage("runs", 12, 24), Stage("runs", 24, 24)]
    reported.clear()
    render(dataset, tmp_path, ["health", "msd"])
    assert reported == [Stage("figures", 1, 2), Stage("figures", 2, 2)]


@pytest.mark.slow
def test_a_movie_reports_its_frames(files, reported):
    movie(read_trajectories(files[0]), str(files[0]), ".gif")
    assert reported == [Stage("frames", k, 2) for k in (1, 2)]


def test_a_trade_off_reports_its_cases_by_the_settings_that_are_measured(files, reported):
    tradeoff.measure(files, seconds_per_run=lambda *_: 1.0)
    assert [stage for stage in reported if stage.unit == "cases"] == [Stage("cases", k / 2, 1) for k in (1, 2)] + [
        Stage("cases", 1, 1)
    ]


def test_a_pilot_reports_its_engines(reported, monkeypatch):
    monkeypatch.setattr(plan.timing, "seconds_per_run", lambda engine, *_, **__: 1.0)
    monkeypatch.setattr("brownpipe.study.run_count.MOST_RUNS", 10)
    plan._by_pilots(SCENE, "msd", (0.2, 1.0), "runs")
    total = 1 + len(plan.candidates(SCENE))
    assert reported[-1] == Stage("engines", total, total) and {stage.unit for stage in reported} == {"engines"}


def test_timing_a_run_times_no_report(reported):
    plan.timing.seconds_per_run(configured("langevin", friction="enskog"), SCENE, repeats=1)
    assert reported == []


# -- the words ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stage", "seconds", "left", "text"),
    [
        (Stage("runs", 1200, 2400), 31.2, 29.8, "simulate: 1,200 of 2,400 runs, 31 s, about 30 s to go"),
        (Stage("runs", 1.4, 8), 200.0, 900.0, "simulate: 1 of 8 runs (18 %), 3.3 min, about 15 min to go"),
        (Stage("runs", 0.37, 1), 12.0, None, "simulate: 37 % of the run, 12 s"),
        (None, 0.3, None, "simulate: 1 s"),
    ],
)
def test_the_line(stage, seconds, left, text):
    assert progress.line("simulate", stage, seconds, left) == text


def test_the_time_left_follows_from_the_reports_alone():
    pace = progress.Pace()
    assert pace.left(100.0, 5, 20) is None  # done before, as the runs of a checkpoint: it took no time
    assert pace.left(101.0, 6, 20) is None
    assert pace.left(110.0, 10, 20) == 20.0
    assert pace.left(120.0, 20, 20) is None


@pytest.mark.parametrize("reports", [(0.5, 5, 0.5), (0.01, 10, 0.02), (1, 0)])
def test_a_stage_that_begins_again_has_a_pace_of_its_own(reports):
    pace = progress.Pace()
    lefts = [pace.left(3.0 * k, done, 10) for k, done in enumerate(reports)]
    assert lefts[-1] is None
    assert pace.left(3.0 * len(reports), reports[-1] + 1, 10) == pytest.approx(3.0 * (9 - reports[-1]))


# -- the screen -----------------------------------------------------------------------------------------------------


def test_a_log_has_a_line_every_half_a_minute(monkeypatch, capsys):
    now = time.monotonic()
    monkeypatch.setattr("brownpipe.progress.time.monotonic", lambda: now)
    with progress.shown("aggregate"):
        for runs in range(71):
            stages.report("runs", runs, 1000)
            now += 1.0
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "aggregate: 30 of 1,000 runs, 30 s, about 16 min to go",
        "aggregate: 60 of 1,000 runs, 60 s, about 16 min to go",
    ]


def test_silent_means_nothing_and_the_outer_one_shows_all(monkeypatch, capsys):
    with progress.shown("simulate", silent=True):
        stages.remark("compiling")
    assert capsys.readouterr() == ("", "")
    with progress.shown("study"), progress.shown("simulate"):
        assert len(stages.listeners) == 1
        stages.remark("compiling")
    assert capsys.readouterr().err == "brownpipe: compiling\n"
    assert stages.listeners == stages.remark_listeners == []


def test_a_screen_that_is_gone_ends_no_calculation(monkeypatch):
    monkeypatch.setattr(progress, "LINE_INTERVAL", 0.0)
    with monkeypatch.context() as patch, open("/dev/full", "w") as screen:
        patch.setattr(sys, "stderr", screen)
        with progress.shown("simulate"):
            stages.remark("compiling")
            stages.report("runs", 1, 2)
        with suppress(OSError):
            screen.close()


WORK = """
import sys, time
from brownpipe import progress, stages
progress.DELAY, progress.LINE_INTERVAL = 0.0, 0.0
with progress.shown("movie"):
    stages.remark("compiling")
    for k in stages.tracked(range(40), "frames"):
        time.sleep(float(sys.argv[1]))
print("made")
"""


def on_terminal(term, columns=100, sleep=0.01, interrupt=False):
    """What a program writes to a terminal of so many columns, and its exit status."""
    ours, theirs = os.openpty()
    termios, fcntl = __import__("termios"), __import__("fcntl")
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    environment = os.environ | {"TERM": term, "NO_COLOR": "1"}
    command = [sys.executable, "-c", WORK, str(sleep)]
    process = subprocess.Popen(command, stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    written = b""
    while True:
        try:
            written += os.read(ours, 65536)
        except OSError:  # the end of a terminal
            break
        if interrupt and b"frames" in written:
            process.send_signal(signal.SIGINT)
            interrupt = False
    os.close(ours)
    return written.decode(), process.wait()


@pytest.mark.slow
def test_a_terminal_has_a_bar_that_is_removed():
    written, status = on_terminal("xterm", columns=60)
    assert status == 0 and "\x1b" not in written
    assert "brownpipe: compiling\r\n" in written
    bars = [text for text in written.split("\r") if text.startswith("movie: ")]
    assert len(bars) > 1 and all(re.search(r"of 40 frames \(\d+ %\), 1 s \|[^|]*\|", text) for text in bars)
    assert max(map(len, bars)) < 60
    assert re.search(r"\r +\rmade\r\n$", written)


@pytest.mark.slow
def test_a_narrow_terminal_has_a_line_that_fits():
    written, _ = on_terminal("xterm", columns=20)
    assert max(len(text) for text in written.split("\r") if text.startswith("movie: ")) <= 20


def test_a_dumb_terminal_has_lines():
    written, _ = on_terminal("dumb")
    assert re.search(r"movie: \d+ of 40 frames \(\d+ %\), 1 s\r\n", written)
    assert "\x1b" not in written and not re.search(r"\r(?!\n)", written)


def test_ctrl_c_removes_the_bar():
    began = time.monotonic()
    written, status = on_terminal("xterm", sleep=0.2, interrupt=True)
    assert status == -signal.SIGINT and time.monotonic() - began < 6
    assert re.search(r"\r +\rTraceback", written) and "made" not in written
