"""What every product says it was made from, and products that come out again byte for byte from that alone."""

import copy
import getpass
import json
import os
import re
import shutil
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest
import xarray
from PIL import Image

from brownpipe import storage, tradeoff
from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, BrownpipeError
from brownpipe.figures import origin
from brownpipe.inspection import products
from brownpipe.provenance import PACKAGE
from brownpipe.scene import read_scene
from brownpipe.storage.origin import _commit, installation, read_origins
from ensembles import make_runs, make_scene, write

pytestmark = pytest.mark.slow

SCENE = Path(__file__).parent.parent / "config" / "scenes" / "harrison2020.yaml"
CASE = "results/s/simulate/harrison2020/N10/exact"
NAMES = ("msd.png", "msd.svg", "msd.csv", "summary.csv", "summary.txt", "provenance.json")
PAGE = "results/s/report.html"
PRODUCTS = ("results/s/aggregate/s.nc", *(f"results/s/figures/{name}" for name in NAMES), PAGE)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study of 20 runs with one figure and a page, in the folders of `brownpipe run`."""
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for seeds in ("0-11", "12-19"):
            simulate = ["simulate", str(SCENE), "--particles", "10", "--seeds", seeds]
            assert main([*simulate, "--output", f"{CASE}/{seeds}.h5"]) == DONE
        files = map(str, Path(CASE).iterdir())
        assert main(["aggregate", *files, "--output", PRODUCTS[0], "--fit-windows", "0.1:1"]) == DONE
        replayed = ["--particles", "10", "--seeds", "0", "--record", "all,events", "--output", "results/s/replay/0.h5"]
        assert main(["simulate", str(SCENE), *replayed]) == DONE
        words = ["--output", "results/s/figures", "--figures", "msd", "--page", PAGE, "--replay", replayed[-1]]
        assert main(["figures", PRODUCTS[0], *words]) == DONE
    return folder


@pytest.fixture
def study(finished, tmp_path, monkeypatch):
    """The current folder: a copy of it."""
    shutil.copytree(finished / "results", tmp_path / "here" / "results")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


def reproduced(capsys, path):
    """Exit status of `inspect --reproduce`, the lines that it prints, and those on stderr."""
    capsys.readouterr()
    status = main(["inspect", str(path), "--reproduce"])
    out, err = capsys.readouterr()
    return status, out.splitlines(), err.splitlines()


# -- what a product says --------------------------------------------------------------------------------------------


@pytest.mark.promise(
    "forgotten origin", "Every product says from which scenes, seeds, engines and versions it was made."
)
def test_a_dataset_has_scenes_seeds_engines_options_and_installation(finished):
    attributes = storage.read_dataset(finished / PRODUCTS[0]).attrs
    (runs,) = read_origins("s.nc", attributes)
    header = storage.trajectories.read_header(finished / CASE / "0-11.h5")
    assert runs.scene == read_scene(SCENE, 10)
    assert (runs.engine, list(runs.seeds), runs.record) == (Engine("exact"), list(range(20)), {"tracer"})
    assert (runs.observables, runs.average, runs.source) == ((), "runs", header["source_digest"])
    (entry,) = json.loads(attributes["made_from"])
    assert entry["command"] == "brownpipe simulate harrison2020.yaml --particles 10 --seeds 0-19 --engine exact"
    options = {"fit_windows": [[0.1, 1.0]], "ring_width": None, "rings": None, "displacement_times": []}
    assert json.loads(attributes["options"]) == options
    assert attributes["python"] == installation()["python"] and attributes["scipy_version"]


@pytest.mark.promise("forgotten origin", "Figures carry this in their metadata; tables have it in provenance.json.")
def test_figures_tables_and_summary_say_what_their_dataset_says(finished):
    attributes = storage.read_dataset(finished / PRODUCTS[0]).attrs
    records = {name: origin.read_record(finished / "results/s/figures" / name) for name in NAMES}
    for name, record in records.items():
        stated = origin.dataset_attributes(record)
        assert stated.pop("sha256") == storage.seal_of(finished / PRODUCTS[0])
        assert read_origins(name, stated) == read_origins("s.nc", attributes)
        assert json.loads(stated["options"]) == json.loads(attributes["options"])
        assert {key: attributes[key] for key in stated if key not in ("options", "made_from")} == {
            key: value for key, value in stated.items() if key not in ("options", "made_from")
        }
        assert (record["figures"], record["particles"]) == (["msd"], None)
        assert record["made_by"]["matplotlib_version"] and record["made_by"]["python"]
        assert record.get("file", name) == name
    assert records["msd.csv"]["files"] == sorted(set(NAMES) - {"provenance.json"})
    with Image.open(finished / "results/s/figures/msd.png") as picture:
        assert json.loads(picture.text["Source"]) == records["msd.png"]
    made, where = (finished / "results/s/figures/summary.txt").read_text().splitlines()[-2:]
    assert re.fullmatch(r"Made by brownpipe \S+, source \w{12}.*, Python 3\S+ from the dataset \w{12}\.", made)
    assert where.endswith("provenance.json")


@pytest.mark.promise("private data in results", "No product names a machine, a user, a folder or a date.")
@pytest.mark.parametrize("product", PRODUCTS)
def test_products_name_no_machine_user_folder_or_date(product, finished):
    contents = (finished / product).read_bytes()
    private = {str(finished), str(Path.home()), socket.gethostname(), str(SCENE.parent), f"/{getpass.getuser()}/"}
    assert [word for word in private if len(word) > 3 and word.encode() in contents] == []
    assert not re.search(rb'"?(date|time_stamp|created)"?[=:]', contents, re.IGNORECASE)


def test_movies_and_exports_say_how_their_run_is_made_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", str(SCENE), "--particles", "3", "--seeds", "4-5", "--record", "all"]) == DONE
    command = "brownpipe simulate harrison2020.yaml --particles 3 --seeds 5 --engine exact --record all"
    for kind in ("gif", "png"):
        assert main(["movie", "harrison2020.h5", "--seed", "5", "--frames", "2", "--output", f"m.{kind}"]) == DONE
        record = origin.record_in(Path(f"m.{kind}").read_bytes())
        assert record["movie"] == {"seed": 5, "frames": 2, "fps": 25.0}
        assert record["made_from"][0]["command"] == command
        with Image.open(f"m.{kind}") as picture:
            assert picture.format.lower() == kind and getattr(picture, "n_frames", 1) == (2 if kind == "gif" else 1)
    ffmpeg = tmp_path / "ffmpeg"
    ffmpeg.write_text('#!/bin/sh\ncat > raw\nfor last; do :; done\nprintf "%s\\n" "$@" > "$last"\n')
    ffmpeg.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert main(["movie", "harrison2020.h5", "--seed", "5", "--frames", "2", "--output", "m.mp4"]) == DONE
    (comment,) = re.findall("^-metadata\ncomment=(.*)$", Path("m.mp4").read_text(), re.MULTILINE)
    assert json.loads(comment)["movie"] == record["movie"]
    assert main(["export", "harrison2020.h5", "--seed", "5", "--to", "xyz"]) == DONE
    assert Path("harrison2020.xyz").read_text().count(f'command="{command}"') == 1
    assert main(["inspect", "m.png", "--reproduce"]) == WRONG_REQUEST


def git(folder, *words):
    who = ["-c", "user.name=a", "-c", "user.email=b", "-c", "init.defaultBranch=main"]
    done = subprocess.run(["git", *who, *words], cwd=folder, capture_output=True, text=True, check=True, timeout=60)
    return done.stdout.strip()


@pytest.mark.promise(
    "modified source", "Results of a git checkout name its commit, and whether the source was modified."
)
def test_the_commit_of_a_checkout_and_whether_it_was_modified(tmp_path, monkeypatch):
    package = tmp_path / "src" / PACKAGE.name
    package.mkdir(parents=True)
    (package / "a.py").write_text("1\n")
    assert _commit(package) is None
    git(tmp_path, "init")
    assert _commit(package) is None  # no commit yet
    git(tmp_path, "add", "src")
    git(tmp_path, "commit", "-m", "one")
    commit = git(tmp_path, "rev-parse", "HEAD")
    assert _commit(package) == commit
    (tmp_path / "notes").write_text("not of the source")
    assert _commit(package) == commit
    (package / "a.py").write_text("2\n")
    assert _commit(package) == f"{commit}, modified"
    git(tmp_path, "checkout", "src")
    (package / "new.py").write_text("3\n")
    assert _commit(package) == f"{commit}, modified"
    inside = tmp_path / ".venv" / "lib" / PACKAGE.name  # installed in a folder that somebody keeps in git
    inside.mkdir(parents=True)
    assert _commit(inside) is None
    monkeypatch.setenv("PATH", "")
    assert _commit(package) is None


# -- made again -----------------------------------------------------------------------------------------------------


@pytest.mark.promise("result that cannot be repeated", "Every product is made again from what it says, byte for byte.")
@pytest.mark.parametrize("product", [PRODUCTS[0], "results/s/figures/provenance.json", PAGE])
def test_products_come_out_again_byte_for_byte(product, study, capsys):
    before = {path: path.stat().st_mtime_ns for path in study.rglob("*")}
    status, lines, err = reproduced(capsys, product)
    assert (status, err, lines[-1]) == (DONE, [], f"identical: every byte of {Path(product).name}")
    source = "drawing again from results/s/aggregate/s.nc: some"
    if product.endswith(".nc"):
        source = "reading 20 runs of harrison2020, N = 10, exact, seeds 0-19: 2 trajectory files, which are not made"
    replayed = ["running again 1 run of harrison2020, N = 10, exact, seed 0, to be replayed"] * (product == PAGE)
    assert lines[:-2] == replayed and lines[-2].startswith(source)
    assert {path: path.stat().st_mtime_ns for path in study.rglob("*")} == before


@pytest.mark.promise(
    "lost files", "A dataset or figure alone is enough: runs are made again from its scenes and seeds."
)
def test_a_product_alone_is_enough(study, tmp_path, monkeypatch, capsys):
    (tmp_path / "alone").mkdir()
    monkeypatch.chdir(tmp_path / "alone")
    alone = shutil.copy(study / "results/s/figures/msd.svg", "renamed.svg")
    shutil.rmtree(study)
    status, lines, err = reproduced(capsys, alone)
    assert re.fullmatch(r"running again 20 runs of harrison2020, N = 10, exact, seeds 0-19: some .* of CPU", lines[0])
    assert (status, err, lines[1:]) == (DONE, [], [f"identical: every byte of {alone}"])


def test_runs_are_made_again_unless_all_their_files_are_there(study):
    path = study / CASE / "12-19.h5"
    assert products.read_product(PRODUCTS[0]).files == ((study / CASE / "0-11.h5", path),)
    path.write_bytes(path.read_bytes()[:-1])
    assert products.read_product(PRODUCTS[0]).files == ((),)
    path.unlink()
    assert products.read_product(PRODUCTS[0]).files == ((),)


def altered_dataset(path):
    dataset = storage.read_dataset(path)
    msd = dataset.msd.copy()
    msd[0, 0, 0, [7, 9]] += 2.0**-40
    storage.write_dataset(path, dataset.assign(msd=msd))


def altered_pixel(path):
    with Image.open(path) as picture:
        text = origin._png_text("Source", picture.text["Source"])
        pixels = np.array(picture)
    pixels[5, 7, 0] ^= 1
    Image.fromarray(pixels).save(path)
    path.write_bytes(path.read_bytes()[: origin.HEAD] + text + path.read_bytes()[origin.HEAD :])


def altered_line(path):
    lines = path.read_text().splitlines(keepends=True)
    lines[2] = f"x\x1b{lines[2]}"
    path.write_text("".join(lines))


ALTERED = {
    "aggregate/s.nc": {
        "aggregate/s.nc": (altered_dataset, r"msd: 2 of 101 values; first at scene harrison2020, particles 10, "
                           r"engine exact, time 0\.07: \S+ in the file, \S+ made again"),
    },
    "figures/provenance.json": {
        "figures/msd.csv": (altered_line, r"msd\.csv: line 3: x\\x1bharrison2020,10.* in the file, harr.* made again"),
        "figures/msd.png": (altered_pixel, r"msd\.png: 1 of [0-9,]+ pixels; first at x = 7, y = 5"),
        "figures/msd.svg": (Path.unlink, r"msd\.svg: is missing"),
    },
}  # fmt: skip


@pytest.mark.promise("altered result", "A product that was altered is named, with the first place that differs.")
@pytest.mark.parametrize("product", ALTERED)
def test_the_first_difference_is_named(product, study, capsys):
    for name, (alter, _) in ALTERED[product].items():
        alter(study / "results" / "s" / name)
    status, (_, *lines), err = reproduced(capsys, f"results/s/{product}")
    assert (status, err, lines[0]) == (FAILED, [], f"different: {Path(product).name}")
    told = [told for _, told in ALTERED[product].values()]
    assert len(lines) == 1 + len(told)
    assert all(re.fullmatch(f"  {one}", line) for one, line in zip(told, lines[1:], strict=True))


@pytest.mark.promise("altered result", "A figure, table or summary with any altered byte is never called identical.")
def test_no_altered_byte_is_called_identical(study, faults, monkeypatch):
    drawn = shutil.copytree(study / "results/s/figures", study / "drawn")
    monkeypatch.setattr(products, "write", lambda *_: [*drawn.iterdir()])
    for _ in faults.tries(5):
        path = study / "results/s/figures" / faults.random.choice(["msd.csv", "summary.txt", "msd.svg", "msd.png"])
        original = path.read_bytes()
        contents = bytearray(original)
        contents[faults.random.randrange(len(contents))] ^= 1 << faults.random.randrange(8)
        path.write_bytes(contents)
        try:
            found = products.differences(products.read_product(path))
        except BrownpipeError:
            found = ["refused"]
        assert found
        path.write_bytes(original)


def places(value, path=()):
    """All places in a nested value, by their keys."""
    yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inner:
        yield from places(item, (*path, key))


@pytest.mark.promise("hostile file", "A record with any wrong value is refused in one line, before anything is run.")
def test_a_record_with_a_wrong_value_ends_in_one_line(study, faults, capsys):
    for name in ("msd.png", "msd.svg"):
        (study / "results/s/figures" / name).unlink()
    (study / PRODUCTS[0]).unlink()
    path = study / "results/s/figures/provenance.json"
    original = json.loads(path.read_text())
    for _ in faults.tries(20):
        record = copy.deepcopy(original)
        *way, last = faults.random.choice([place for place in places(record) if place and place[0] != "files"])
        inner = record
        for key in way:
            inner = inner[key]
        junk = faults.random.choice([None, -1, 1e308, "\x1b[2J", "../x", [], {}, [[]], {"a": 1}, True])
        inner[last] = junk
        path.write_text(json.dumps(record))
        capsys.readouterr()
        status = main(["inspect", str(path.with_name("msd.csv"))])
        out, err = capsys.readouterr()
        assert "\x1b" not in out + err, (way, last, junk)
        assert (status == DONE and not err) or (status != DONE and err.count("\n") == 1), (way, last, junk)


def test_another_source_is_said_first(study, capsys, monkeypatch):
    monkeypatch.setattr(products, "made_by", lambda step: storage.made_by(step) | {"source_digest": 64 * "0"})
    monkeypatch.setattr(products, "differences", lambda _: [])  # other tests make it again
    _, lines, _ = reproduced(capsys, PRODUCTS[0])
    assert re.fullmatch(r"results may differ: the file was made with source of aggregate \w{12}, here 0{12}", lines[1])


def test_products_say_in_words_what_they_were_made_from(study, capsys):
    capsys.readouterr()
    assert main(["inspect", "results/s/figures/msd.csv"]) == DONE
    made, dataset, runs, again = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"results/s/figures/msd\.csv  made by brownpipe \S+, source \w{12},.* Python 3\S+", made)
    assert re.fullmatch(r"dataset      \w{12}, results/s/aggregate/s\.nc", dataset)
    assert runs == "runs         20 runs of harrison2020, N = 10, exact, seeds 0-19"
    assert again == "run again    brownpipe inspect results/s/figures/msd.csv --reproduce"


@pytest.mark.parametrize("name", ["table.csv", "figure.png", "none.svg", "old.nc"])
def test_files_that_say_nothing_of_their_origin_are_refused(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    if name == "table.csv":
        Path(name).write_text("a,b\n")
    elif name == "figure.png":
        Image.new("RGB", (2, 2)).save(name)
    elif name == "old.nc":
        storage.write_dataset(name, xarray.Dataset({"msd": ("time", [0.0, 1.0])}))
    status, lines, err = reproduced(capsys, name)
    assert (status, lines, len(err)) == (WRONG_REQUEST, [], 1)
    assert re.fullmatch(rf"brownpipe: {name}: (does not say what it was made from.*|cannot be read: .*)", err[0])


@pytest.mark.parametrize(
    "wrong",
    [{"made_from": "[7"}, {"made_from": "[7]"}, {"made_from": '[{"command": 1}]'}, {"options": "{"}, {"note": 3.0}],
    ids=str,
)
def test_figures_of_a_dataset_with_other_attributes_are_refused(study, wrong, capsys):
    dataset = "results/s/aggregate/s.nc"
    storage.write_dataset(dataset, storage.read_dataset(dataset).assign_attrs(wrong))
    capsys.readouterr()
    assert main(["figures", dataset, "--output", "none", "--figures", "msd"]) == FAILED
    refusal = f"brownpipe: {dataset}: does not say what it was made from; make it again with this brownpipe\n"
    assert capsys.readouterr() == ("", refusal)
    assert not Path("none").exists()


def test_measured_times_of_a_trade_off_are_not_compared(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exact = make_runs(make_scene("full"), range(30))
    files = [
        write(tmp_path, exact),
        write(tmp_path, exact._replace(engine=Engine("langevin", (("friction", "enskog"),)))),
    ]
    measured = tradeoff.measure(files, seconds_per_run=lambda engine, _: 1e-3 if engine.name == "exact" else 3e-4)
    storage.write_dataset("t.nc", measured)
    status, lines, err = reproduced(capsys, "t.nc")
    assert (status, err) == (DONE, [])
    assert lines[-1].startswith("identical: every byte of t.nc; not compared: seconds, study_seconds, cost_ratio,")
    assert main(["figures", "t.nc", "--output", "figures"]) == DONE
    assert reproduced(capsys, "figures/provenance.json")[0] == DONE
    storage.write_dataset("t.nc", measured.assign(msd_bias=measured.msd_bias + 1e-9))
    status, lines, _ = reproduced(capsys, "t.nc")
    assert status == FAILED and lines[-1].startswith("  msd_bias: 2 of 2 values; first at scene full, setting ")
    for lacking, what in ((measured.drop_vars("seconds"), "only in"), (measured.isel(scene=0), "of another shape")):
        storage.write_dataset("t.nc", lacking)
        status, lines, err = reproduced(capsys, "t.nc")
        assert (status, err) == (FAILED, []) and any(line.startswith(f"  seconds: {what}") for line in lines)
    Path("t.nc").unlink()
    for path in files:
        path.unlink()
    status, _, err = reproduced(capsys, "figures/tradeoff.csv")
    assert status == FAILED and "needs its dataset, which is not beside it: CPU times are measured anew" in err[0]
