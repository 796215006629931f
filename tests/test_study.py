"""The study: which runs are made, in which batches, and what is made of them."""

import re
import shutil
from itertools import chain, pairwise, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from brownpipe.engines import Engine, forecast
from brownpipe.errors import RequestError
from brownpipe.needs import FIGURES
from brownpipe.provenance import source_digest
from brownpipe.scene.reading import validated
from brownpipe.scene.seeds import Seeds, ranges, seed_text
from brownpipe.storage.store import seeds_without_file, stored_batches
from brownpipe.study import Study, read_study
from brownpipe.study.run_sets import (
    commands,
    digests,
    figure_options,
    files_of,
    run_sets,
    split_into_batches,
)
from brownpipe.study.study import Rings
from brownpipe.study.workflow import from_command_line

CONFIG = Path(__file__).parent.parent / "config"
SCENE = CONFIG / "scenes" / "harrison2020.yaml"


def small(**overrides):
    return read_study(CONFIG / "small.yaml", overrides)


@pytest.mark.parametrize("file", sorted(CONFIG.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_study_that_is_there_is_valid_and_says_what_it_shows(file):
    study = read_study(file)
    assert study.tolerance or files_of(study)
    assert file.read_text().startswith("# ")  # the gallery shows it


def test_default_study_is_the_note(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where there are no runs
    study = read_study(CONFIG / "harrison2020.yaml")
    assert study.name == "harrison2020"
    scenes = ("harrison2020", "harrison2020_thermal")
    expected = list(product(scenes, (50, 100, 150, 200)))
    assert [(case.name, case.particles) for case in study.cases] == expected
    assert [file.path.name for file in files_of(study)] == 8 * ["0-2399.h5"]
    assert len(run_sets(study)) == 8
    assert {use.engine for use in study.uses} == {Engine("exact")}
    assert (study.rings.dr, study.rings.count) == (0.04, 24)
    assert all(path.is_file() for path in study.scene_files)


def test_files_are_every_case_by_every_batch_in_folders_of_what_determines_the_runs(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    paths = [str(file.path) for file in files_of(small(particles=[50]))]
    assert len(set(paths)) == len(paths) == 4
    assert re.fullmatch(r"results/runs/harrison2020/N50/exact-[0-9a-f]{8}/0-29\.h5", paths[0])
    analysed_otherwise = small(particles=[50], fit_windows=[[0.2, 1]], seeds="0-59")
    assert paths == [str(file.path) for file in files_of(analysed_otherwise)]
    assert len(commands(small(particles=[50], engines=ALL_ENGINES))) == 8
    namesake = shutil.copy(SCENE, tmp_path / "of_the_same_text.yaml")
    twice = small(particles=[50], scenes=[str(SCENE), str(namesake)])
    assert len(commands(twice)) == 2


@given(
    st.sets(st.integers(0, 60), min_size=1),
    st.lists(st.tuples(st.integers(0, 60), st.integers(0, 20)), max_size=8),
)
@example(seeds={5, 10, 15}, stored=[(0, 10), (10, 10)])  # 0-10.h5 and 10-20.h5 share seed 10
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_stored_and_new_batches_hold_each_seed_once(tmp_path, seeds, stored):
    folder = tmp_path / str(len(list(tmp_path.iterdir())))
    folder.mkdir()
    for first, more in stored:
        (folder / f"{first}-{first + more}.h5").touch()
    wanted = np.array(sorted(seeds))
    chosen = stored_batches(folder, wanted)
    held = [seed for first, last in chosen for seed in range(first, last + 1)]
    assert len(held) == len(set(held))
    left = seeds_without_file(wanted, chosen)
    assert sorted([*(seeds & set(held)), *left]) == wanted.tolist()
    files = [set(range(first, first + more + 1)) for first, more in stored]
    with_seeds_left = [file for file in files if file & set(left.tolist())]
    for file in with_seeds_left:
        assert file & set(held)  # it could not be used


def test_title_note_and_panel_concern_the_figures_alone():
    study = small(title="Hot and cold", note="Two baths.", panel=["scene"])
    assert figure_options(study) == ["--panel=scene", "--title=Hot and cold", "--note=Two baths."]
    assert figure_options(small()) == []
    assert figure_options(small(figures=["msd"])) == ["--figures=msd"]
    masses = small(vary={"disks.tracer.mass": [1, 3]}, panel="disks.tracer.mass")
    assert figure_options(masses) == ["--panel=tracer_mass"]


ALL = {"runs", "plan", "aggregate", "figures", "tradeoff", "tradeoff_figures"}
LATER = ALL - {"runs"}
ANALYSIS = {"aggregate", "figures"}
FIGURE = {"figures"}
TRADEOFF = {"tradeoff", "tradeoff_figures"}
OTHERS = {  # keys with another value than in config/small.yaml, and what is made from it
    "scenes": ("scenes/harrison2020.yaml", ALL),
    "particles": ([50], ALL),
    "vary": ({"duration": [1, 2]}, ALL),
    "vary_together": (True, ANALYSIS),
    "shown_particles": (50, FIGURE),
    "seeds": (7, LATER),
    "tolerance": (0.1, LATER),
    "engines": ([{"name": "timestep", "time_step": 0.001}], ALL),
    "target": ("d", LATER),
    "batch": (7, set()),
    "record": (("none",), ALL),
    "observables": ("species_energy", ALL),
    "average": ("origins", ALL),
    "title": ("A", FIGURE),
    "note": ("B", FIGURE),
    "figures": ("msd", FIGURE),
    "panel": ("scene", FIGURE),
    "displacement_times": ([0.5], ANALYSIS),
    "rings": ({"dr": 0.1, "count": 9}, ANALYSIS),
    "allow_failed": (7, set()),
    "fit_windows": ([[0.2, 1], [0.5, 1]], LATER),
    "instead_of": ({"harrison2020": "harrison2020_thermal"}, TRADEOFF),
}


def made_from(study):
    return digests(study) | {"runs": commands(study).keys()}


def due(before, after):
    return {step for step in before if before[step] != after[step]}


@pytest.mark.parametrize("key", Study.model_fields)
def test_each_key_makes_the_steps_due_that_are_made_from_it_and_no_others(key):
    value, expected = OTHERS[key]
    before = small()
    replaced = {key: value}
    alone = key not in ("average", "record")  # they must go with others
    after = small(**replaced) if alone else before.model_copy(update=replaced)
    assert due(made_from(before), made_from(after)) == expected
    if (
        key == "fit_windows"
    ):  # the first one is that of plans; a dataset says if windows were asked for
        assert (
            due(made_from(before), made_from(small(fit_windows=[[0.1, 1], [0.4, 1]]))) == ANALYSIS
        )
        unasked = small(fit_windows=None)
        assert (
            due(made_from(unasked), made_from(small(fit_windows=unasked.fit_windows))) == ANALYSIS
        )


DRAWN = FIGURE | {"tradeoff_figures"}
SOURCES = {"simulate": ALL, "aggregate": ANALYSIS, "tradeoff": LATER - ANALYSIS, "figures": DRAWN}


@pytest.mark.parametrize("changed", SOURCES)
def test_a_changed_source_makes_its_step_due_and_all_after_it(monkeypatch, changed):
    def digest(step, *of_engine):
        return "changed" if step == changed else source_digest(step, *of_engine)

    before = made_from(small())
    for module in ("storage.store", "study.run_sets"):
        monkeypatch.setattr(f"brownpipe.{module}.source_digest", digest)
    assert due(before, made_from(small())) == SOURCES[changed]


@pytest.mark.parametrize(
    ("figure", "observables"), [("thermodynamics", []), ("energy", "species_energy")]
)
def test_figures_are_drawn_of_engines_that_measure_what_they_show(figure, observables):
    langevin = {"name": "langevin", "friction": "enskog"}
    assert figure not in small(engines=[langevin], observables=observables).figures
    assert figure in small(engines=[langevin, "exact"], observables=observables).figures


def test_scenes_are_found_from_the_folder_of_the_study(tmp_path, monkeypatch):
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "one.yaml").write_text(
        "box: {x: [0, 1], y: [0, 1]}\ndisks: []\nduration: 1\n"
    )
    (tmp_path / "study.yaml").write_text("scenes: scenes/one.yaml\nseeds: 3\n")
    monkeypatch.chdir("/")
    study = read_study(tmp_path / "study.yaml")
    assert study.scene_files == [tmp_path / "scenes" / "one.yaml"]
    (told,) = commands(study).values()
    assert told.startswith(str(tmp_path / "scenes" / "one.yaml").lstrip("/"))  # seen from here
    without_needs = tuple(name for name, needs in FIGURES.items() if not needs)
    assert study.figures == without_needs  # nothing moves
    assert study.fit_windows == ((0.1, 1.0), (0.5, 1.0))
    assert study.displacement_times == ()


ALL_ENGINES = [
    "exact",
    {"name": "timestep", "time_step": 0.001},
    {"name": "timestep", "time_step": 1e-5},
    {"name": "langevin", "friction": "enskog"},
]


def test_what_is_measured_in_the_runs(tmp_path):
    def told(study):
        return (
            next(iter(commands(study).values()))
            .partition(" --record ")[2]
            .partition(" --planned ")[0]
        )

    assert told(small()) == "tracer"
    assert told(small(record=["events", "velocity"])) == "tracer,events,velocity"
    assert told(small(record="all")) == "tracer,all"
    assert small(record="all").figures == small().figures
    study = small(observables=["square_displacement", "species_energy"], record="none")
    assert told(study) == "none --observables square_displacement,species_energy --average runs"
    of_tracer = ("msd", "displacement_distribution", "diffusion")
    assert study.figures == (*of_tracer, "energy", "thermodynamics", "scan", "health")
    study = small(observables="species_energy", record="none", fit_windows=None)
    assert study.figures == ("energy", "thermodynamics", "health")
    vary = [
        {"box.boundary": boundaries} for boundaries in (["periodic"], ["periodic", "reflecting"])
    ]
    shown = [
        "density_profile" in small(observables="density_profile", vary=one).figures for one in vary
    ]
    assert shown == [False, True]
    thermal = (CONFIG / "scenes" / "harrison2020_thermal.yaml").read_text()
    (tmp_path / "mixed.yaml").write_text(thermal + "equilibrate: {time: 1, tracer: free}\n")
    study = small(
        scenes=str(tmp_path / "mixed.yaml"), observables="square_displacement", average="origins"
    )
    assert told(study) == "tracer --observables square_displacement --average origins"
    assert {*study.figures} > {*of_tracer}
    without_trajectories = small(
        scenes=str(tmp_path / "mixed.yaml"),
        observables="square_displacement",
        average="origins",
        record="none",
    )
    assert "displacement_distribution" not in without_trajectories.figures


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"record": ["none", "events"]}, "record: must be none alone, or others"),
        ({"record": ["events", "events"]}, "record: must be values that differ"),
        (
            {"record": "events", "engines": ALL_ENGINES[:2]},
            r"engines\[1\]: --record events: the ti",
        ),
        ({"record": "all", "engines": ALL_ENGINES[3]}, r"engines\[0\]: --record all: the langevin"),
    ],
)
def test_what_cannot_be_recorded(keys, message):
    with pytest.raises(RequestError, match=message):
        small(**keys)


def test_what_is_recorded_decides_the_forecast_of_its_size():
    sizes = []
    for record in ("none", "tracer", ["velocity", "events"], ["all", "events"]):
        first = run_sets(small(record=record, fit_windows=None))[0]
        sizes.append(first.cost.bytes_in_file)
    assert sizes == sorted(sizes)
    assert len({*sizes}) == 4


# -- keys replaced by `snakemake --config` ---------------------------------------------------------


def replaced(*entries):
    """The study with keys replaced as on the command line of Snakemake, which reads numbers in
    lists as text.
    """
    from snakemake.cli import parse_config

    return read_study(CONFIG / "small.yaml", from_command_line(parse_config(entries)))


def test_replaced_keys():
    study = replaced("seeds=[0-1,17]", "figures=[msd, health]", "rings={dr: 0.04, count: 24}")
    assert study.seeds == (0, 1, 17)
    assert study.figures == ("msd", "health")
    assert study.rings == Rings(dr=0.04, count=24)


def test_seeds_and_tolerance_replace_each_other(tmp_path):
    study = replaced("tolerance=2%", "target=d")
    assert (study.tolerance, study.target, study.seeds) == (0.02, "d", range(2500))
    (tmp_path / "study.yaml").write_text(f"scenes: {SCENE}\ntolerance: 2%\ntarget: d\n")
    study = read_study(tmp_path / "study.yaml", {"seeds": 3})
    assert (study.tolerance, study.seeds) == (None, range(3))


# -- seeds ---


@given(st.sets(st.integers(0, 60), min_size=1))
@settings(max_examples=200, deadline=None)
def test_seeds_written_one_by_one_or_in_ranges_are_the_same(seeds):
    one_by_one = validated(Seeds, ",".join(map(str, seeds)))
    assert list(one_by_one) == sorted(seeds)
    in_ranges = ",".join(f"{first}-{last}" for first, last in ranges(one_by_one))
    assert list(validated(Seeds, in_ranges)) == list(one_by_one)
    assert list(validated(Seeds, seed_text(one_by_one))) == list(one_by_one)


def test_seeds_as_text():
    cases = {
        "": [],
        "17": [17],
        "0-599": range(600),
        "0-2,7,9-10": [0, 1, 2, 7, 9, 10],
        "0,2,4": range(0, 6, 2),
    }
    for text, seeds in cases.items():
        assert seed_text(seeds) == text
    assert list(validated(Seeds, "9,3,5,3")) == [3, 5, 9]
    assert list(validated(Seeds, "0-9,2-3,5")) == list(range(10))
    assert validated(Seeds, "0-499999,500000-999999") == (*range(1_000_000),)


@given(st.sets(st.integers(0, 100), min_size=1), st.integers(1, 20))
@settings(max_examples=100, deadline=None)
def test_batches_hold_each_seed_once_and_at_most_as_many_as_asked_for(seeds, batch):
    found = split_into_batches(tuple(sorted(seeds)), forecast.Cost(0, 0, 1.0, 0, 0, 0), batch)
    ranges_of_seeds = [range(first, last + 1) for first, last in found]
    assert list(chain.from_iterable(ranges_of_seeds)) == sorted(seeds)
    assert all(len(seeds_of_batch) <= batch for seeds_of_batch in ranges_of_seeds)


# -- batch: auto ---

COSTS = st.builds(
    forecast.Cost,
    *(st.just(0.0),) * 2,
    seconds=st.floats(1e-6, 1e5),
    bytes_in_file=st.floats(0, 1e8),
    bytes_until_written=st.floats(0, 1e8),
    working_bytes=st.floats(0, 1e10),
    seconds_per_process=st.floats(0, 100),
)


@pytest.mark.slow
@given(COSTS, st.integers(1, 10**5), st.integers(0, 10**5), st.integers(1, 10**5))
@settings(max_examples=60, deadline=None)
def test_automatic_batches_hold_each_seed_once_and_stay_when_seeds_are_added(
    cost, runs, first, more
):
    found = split_into_batches(range(first, first + runs), cost)
    assert found[0][0] == first
    assert found[-1][1] == first + runs - 1
    assert all(before[1] + 1 == after[0] for before, after in pairwise(found))
    assert found == [
        (first + one, first + last) for one, last in split_into_batches(range(runs), cost)
    ]
    longer = split_into_batches(range(first, first + runs + more), cost)
    assert longer[: len(found) - 1] == found[:-1]
    assert longer[len(found) - 1][1] >= found[-1][1]


@pytest.mark.parametrize(
    ("seconds", "days", "most_jobs", "longest_job"),
    [
        (1.0, 1 / 24, 240, 20),
        (1.0, 10, 2600, 3600),
        (1e-3, 1, 1400, 600),
        (10.0, 365, 4000, 2 * 86400),
    ],
)
def test_automatic_batches_take_tens_of_seconds_and_more_where_they_are_many(
    seconds, days, most_jobs, longest_job
):
    found = split_into_batches(
        range(int(days * 86400 / seconds)), forecast.Cost(0, 0, seconds, 0, 0, 0)
    )
    assert 15 <= (found[0][1] + 1) * seconds <= 30
    assert len(found) <= most_jobs
    assert max(last - first + 1 for first, last in found) * seconds <= longest_job


# -- refusals: test_wrong_input.py ---
