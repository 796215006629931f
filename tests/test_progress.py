"""How much of a long calculation is done: what is reported, and what a terminal or a log shows of it."""

import json
import os
import re
import signal
import struct
import subprocess
import sys
import time
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest

from brownpipe import analysis, progress, stages, tradeoff
from brownpipe.engines import configured
from brownpipe.engines.exact import run as exact_run
from brownpipe.engines.timestep import simulation as timestep
from brownpipe.figures.movie import movie
from brownpipe.figures.snapshot import whole_run
from brownpipe.storage.trajectories import read_trajectories, write_trajectories
from brownpipe.study import plan, read_study
from synthetic import render
from test_exact import P, box, make

SCENE = make(box(6, 6, P), [(1, 0.6, 9), (30, 0.25, 1)], 4.0).replace(equilibrate=4.0)
EXACT, STEPS = configured("exact"), configured("timestep", time_step=0.01)


@pytest.fixture
def reported(monkeypatch):
    """The stages that are reported during the test: unit, done and total."""
    found = []
    monkeypatch.setattr(stages, "listeners", [lambda *stage: found.append(stage)])
    return found


# -- what is reported -----------------------------------------------------------------------------------------------


def test_a_piece_is_reported_by_what_is_tracked_within_it_and_by_nothing_else(reported):
    for _ in stages.tracked("ab", "cases"):
        stages.report("runs", 1, 3)
        for _ in stages.tracked("cd", "engines"):
            stages.report("runs", 2, 3)
    shares = [0.5, 1, 1]  # of a case: after each engine, at its end
    assert reported == [("cases", case + share, 2) for case in (0, 1) for share in shares]


def shares(reported, runs):
    """The fractions of a batch that were reported, which must never fall."""
    assert {(unit, total) for unit, _, total in reported} == {("runs", runs)}
    done = [done for _, done, _ in reported]
    assert done == sorted(done)
    return done


@pytest.mark.parametrize("engine", [EXACT, STEPS], ids=lambda engine: engine.name)
def test_a_run_is_reported_by_simulated_time_and_stays_the_same(engine, monkeypatch):
    before = engine.simulate(SCENE, [3, 4], {"tracer"}).tracer.position
    monkeypatch.setattr(exact_run, "EVENTS_PER_CALL", 60)
    monkeypatch.setattr(timestep, "DISK_STEPS_PER_CALL", 31 * 39)
    found = []
    monkeypatch.setattr(stages, "listeners", [lambda *stage: found.append(stage)])
    after = engine.simulate(SCENE, [3, 4], {"tracer"}).tracer.position
    assert after.tobytes() == before.tobytes()
    done = np.array(shares(found, 2))
    inside = done % 1
    assert np.count_nonzero((inside > 0) & (inside < 0.5)) > 2 < np.count_nonzero(inside > 0.5)  # half equilibrates
    assert {1.0, 2.0} <= set(done) and done[0] < 0.2


def test_runs_that_measure_a_friction_are_no_runs_of_the_batch(reported):
    configured("langevin", friction="measured").simulate(SCENE, [0, 1, 2], {"tracer"})
    assert reported == [("runs", k, 3) for k in (1, 2, 3)]


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
    assert reported[:2] == [("files verified", 1, 2), ("files verified", 2, 2)]
    assert reported[2:] == [("runs", 12, 24), ("runs", 24, 24)]
    reported.clear()
    render(dataset, tmp_path, ["health", "msd"])
    assert reported == [("figures", 1, 2), ("figures", 2, 2)]


@pytest.mark.slow
def test_a_movie_reports_its_frames(files, reported):
    movie(whole_run(read_trajectories(files[0]), str(files[0])), ".gif", {})
    assert reported == [("frames", k, 2) for k in (1, 2)]


def test_a_trade_off_reports_its_cases_by_the_settings_that_are_measured(files, reported):
    tradeoff.measure(files, seconds_per_run=lambda *_: 1.0)
    assert [stage for stage in reported if stage[0] == "cases"] == [("cases", k / 2, 1) for k in (1, 2)] + [
        ("cases", 1, 1)
    ]


def test_a_plan_reports_its_cases(reported, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("brownpipe.study.cost.MOST_PILOT_RUNS", 10)
    (tmp_path / "scene.yaml").write_text(json.dumps(SCENE.model_dump(exclude_unset=True)))
    engines = "engines: [exact, {name: langevin, friction: enskog}]"
    (tmp_path / "study.yaml").write_text(f"scenes: scene.yaml\nseeds: 5\n{engines}\n")
    plan.performance_of(read_study("study.yaml"), "msd")
    assert reported[-1] == ("cases", 1, 1) and {unit for unit, _, _ in reported} == {"cases"}


def test_timing_a_run_times_no_report(reported):
    tradeoff.timing.seconds_per_run(configured("langevin", friction="enskog"), SCENE, repeats=1)
    assert reported == []


# -- the screen -----------------------------------------------------------------------------------------------------


@pytest.fixture
def clock(monkeypatch):
    """The time of the display, in its attribute `now` [s]."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr("brownpipe.progress.time.monotonic", lambda: clock.now)
    return clock


def test_a_log_has_a_line_every_half_a_minute(clock, capsys):
    with progress.shown("aggregate"):
        for runs in range(71):
            stages.report("runs", runs, 1000)
            clock.now += 1.0
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "aggregate: 30 of 1,000 runs (3 %), 30 s, about 16 min to go",
        "aggregate: 60 of 1,000 runs (6 %), 60 s, about 16 min to go",
    ]


@pytest.mark.parametrize(
    ("reports", "left"),
    [
        ((5, 6, 10), 2 * 10 / 5),  # 5 were done before, as the runs of a checkpoint: they took no time
        ((0.5, 5, 0.2, 1.2), 8.8),  # begun again
        ((1, 10), None),
    ],
)
def test_the_time_left_follows_from_the_pace_since_the_stage_began(clock, capsys, reports, left):
    display = progress.Display()
    for done in reports:
        clock.now += 1.0
        display.due = clock.now
        display.update("x", done, 10 if left != 4 else 20)
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == f"x, {len(reports)} s" + (f", about {left:.0f} s to go" if left else "")


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
progress.DELAY, progress.INTERVAL, progress.LINE_INTERVAL = 0.0, 0.0, 0.0
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
@pytest.mark.parametrize("columns", [20, 60])
def test_a_terminal_has_a_line_that_fits_and_is_removed(columns):
    written, status = on_terminal("xterm", columns)
    assert status == 0 and "\x1b" not in written
    assert "brownpipe: compiling\r\n" in written
    lines = [text for text in written.split("\r") if text.startswith("movie: ")]
    assert len(lines) > 1 and max(map(len, lines)) < columns
    assert re.search(r"\r +\rmade\r\n$", written)


def test_a_dumb_terminal_has_lines():
    written, _ = on_terminal("dumb")
    assert re.search(r"movie: \d+ of 40 frames \(\d+ %\), 1 s, about 1 s to go\r\n", written)
    assert "\x1b" not in written and not re.search(r"\r(?!\n)", written)


def test_ctrl_c_removes_the_line():
    began = time.monotonic()
    written, status = on_terminal("xterm", sleep=0.2, interrupt=True)
    assert status == -signal.SIGINT and time.monotonic() - began < 6
    assert re.search(r"\r +\rTraceback", written) and "made" not in written
