"""The scene: what a file says is what is simulated, and the canonical text says it again."""

import json
import math
import tempfile
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from brownpipe.engines.exact import layout
from brownpipe.engines.exact.simulation import simulate
from brownpipe.errors import RequestError
from brownpipe.scene import Scene, Species, parse_scene
from brownpipe.scene.reading import read_yaml, yaml_text
from brownpipe.storage.configurations import read_scene
from scenes import CHANNEL_X, CHANNEL_Y

CONFIG = Path(__file__).parent.parent / "config"
BOX = {"x": [-3.0, 3.0], "y": [-3.0, 3.0], "boundary": "reflecting"}


def disk(x=0.0, y=0.0, radius=0.1, mass=1.0, velocity=(1.0, 0.0)):
    return {"position": [x, y], "velocity": list(velocity), "radius": radius, "mass": mass}


def explicit(*disks, box=BOX, **more):
    return parse_scene({"box": box, "disks": list(disks), "duration": 1.0, **more}, "test.yaml")


def species(*kinds, box=BOX, particles=None, **disks):
    mapping = {
        "box": box,
        "disks": {"species": list(kinds), **disks},
        "velocities": {"temperature": 1.0},
    }
    return parse_scene(mapping | {"duration": 1.0}, "test.yaml", particles)


def kind(count, radius=0.1, name="bath", mass=1.0):
    return {"name": name, "count": count, "radius": radius, "mass": mass}


# -- the note ---


def test_note_as_published():
    scene = read_scene(CONFIG / "scenes" / "harrison2020.yaml")
    tracer, bath = scene.species
    assert (tracer.name, tracer.count, tracer.radius, tracer.mass, tracer.position) == (
        "tracer",
        1,
        0.3,
        1,
        (0, 0),
    )
    assert bath == Species(name="bath", count=149, radius=0.1, mass=0.4)
    assert (scene.name, scene.particles, scene.velocities.standard_deviation) == (
        "harrison2020",
        150,
        2.0,
    )
    assert scene.packing_fraction == pytest.approx(math.pi * (0.09 + 149 * 0.01) / 36, rel=1e-15)
    assert scene.radius.tolist() == [0.3] + 149 * [0.1]
    assert scene.mass.tolist() == [1.0] + 149 * [0.4]
    assert scene.times.tolist() == [float(f"0.{k:02}") for k in range(100)] + [1.0]


# -- defaults, text and digest ---


def test_digest_is_of_the_physics_alone():
    scene = species(kind(149), tracer={"radius": 0.3, "mass": 1.0})
    same = species(kind("rest"), tracer={"mass": 1, "radius": 0.3}, particles=150)
    assert same == scene
    assert same.digest == scene.digest == parse_scene(scene.as_mapping(), "other.yaml").digest
    assert (
        len(
            {scene.digest, species(kind(149, mass=1.1), tracer={"radius": 0.3, "mass": 1.0}).digest}
        )
        == 2
    )
    assert explicit(disk(x=-0.0)).digest == explicit(disk(x=0.0)).digest
    assert len({scene, same}) == 1  # hashable


lengths = st.floats(1e-3, 0.3)
heaviest = st.floats(1e-100, 1e300)
ratios = st.floats(1e-200, 1)
components = st.floats(-1e160, 1e160)


@st.composite
def scenes(draw) -> Scene:
    """Species of any masses in boxes anywhere, and lists of disks on a grid so wide that they
    cannot overlap.
    """
    low, duration = draw(st.floats(-1e6, 1e6)), draw(st.floats(1e-150, 1e9))
    box = {
        "x": [low, low + 7],
        "y": [0.0, 9.0],
        "boundary": draw(st.sampled_from(["reflecting", "periodic"])),
    }
    mapping = {
        "box": box,
        "duration": duration,
        "sample_interval": duration / draw(st.integers(1, 1000)),
    }
    most = draw(heaviest)
    masses = ratios.map(lambda ratio: max(ratio * most, 1.001e-200 * most))
    if draw(st.booleans()):
        disks = [
            disk(
                low + 1 + i, 1.0, draw(lengths), draw(masses), (draw(components), draw(components))
            )
            for i in range(3)
        ]
        return parse_scene(mapping | {"disks": disks[: draw(st.integers(0, 3))]}, "drawn.yaml")
    kinds = [
        kind(draw(st.integers(0, 9)), draw(lengths), f"kind-{i}", draw(masses)) for i in range(2)
    ]
    disks = {"species": kinds, "placement": draw(st.sampled_from(["random", "lattice"]))}
    if draw(st.booleans()):
        disks["tracer"] = {"radius": draw(lengths), "mass": draw(masses)}
        disks["tracer"] |= draw(st.sampled_from([{}, {"position": [low + 1, 1.0]}]))
        mapping["equilibrate"] = {"time": draw(st.sampled_from([0, 2.5])), "tracer": "free"}
    spread = draw(st.sampled_from(["standard_deviation", "temperature"]))
    energy = st.floats(1e-5, 1e5).map(lambda square: square * most)
    sizes = {"standard_deviation": st.floats(0, 1e160), "temperature": st.just(0.0) | energy}
    velocities = {spread: draw(sizes[spread]), "zero_momentum": draw(st.booleans())}
    return parse_scene(mapping | {"disks": disks, "velocities": velocities}, "drawn.yaml")


@given(scenes())
@settings(max_examples=100, deadline=None)
def test_text_reads_back_as_the_same_scene(scene):
    again = parse_scene(json.loads(scene.text), scene.name)
    assert again == scene
    assert again.text == scene.text
    assert parse_scene(read_text(yaml_text(scene.as_mapping())), scene.name) == scene


def read_text(text):
    """The value of a YAML text, as of a file."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        file.write(text)
        file.flush()
        return read_yaml(file.name)


# -- sample times ---


@given(st.floats(1e-150, 1e9), st.floats(1, 1000))
@settings(max_examples=200, deadline=None)
def test_times_are_multiples_and_end_at_the_duration(interval, intervals):
    scene = explicit(duration=interval * intervals, sample_interval=interval)
    times = scene.times
    assert times[-1] == scene.duration
    rounded_once = [float(k * Fraction(repr(interval))) for k in range(len(times) - 1)]
    product = np.arange(len(times) - 1) * interval  # of intervals that no short decimal is
    assert times[:-1].tolist() in (rounded_once, product.tolist())
    assert np.all(np.diff(times) > 0)
    assert np.all(np.diff(times) < interval * (1 + 2e-6))


@pytest.mark.parametrize(
    ("duration", "interval", "count"),
    [(1.0, 0.1, 11), (math.nextafter(1, 2), 0.1, 11), (0.3, 0.1, 4), (1.0, 0.3, 5), (5.0, 5.0, 2)],
)
def test_number_of_samples(duration, interval, count):
    assert len(explicit(duration=duration, sample_interval=interval).times) == count


@pytest.mark.parametrize(
    "interval",
    ["0.1", "0.07", "0.001", "1e-3", "0.15", "2.3e-7", "0.123456789012", "1700.3", "3e41"],
)
def test_sample_times_are_what_one_writes(interval):
    """To the bit, whatever the number of samples: a longer run has the times of a shorter one."""
    duration = float(2345 * Decimal(interval))
    times = explicit(duration=duration, sample_interval=float(interval)).times
    assert times.tolist() == [float(k * Decimal(interval)) for k in range(2346)]
    longer = explicit(duration=9 * duration, sample_interval=float(interval)).times
    assert longer[:2346].tolist() == times.tolist()


def test_sample_times_of_thirds_are_multiples_of_the_third():
    times = explicit(duration=700.0, sample_interval=1 / 3).times
    assert times[[3, 6, 300]].tolist() == [1.0, 2.0, 100.0]


@pytest.mark.parametrize("first", ["0.07", "3e-4", "0.0125", "1.1e-6"])
def test_whole_decades_of_logarithmic_times_are_what_one_writes(first):
    times = explicit(duration=100.0, samples={"per_decade": 7, "first": float(first)}).times
    decades = times[1:-1:7].tolist()
    assert decades == [float(Decimal(first).scaleb(k)) for k in range(len(decades))]
    assert len(decades) > 3


@given(st.floats(1e-150, 1e150), st.floats(1e-12, 0.99999), st.integers(1, 300))
@settings(max_examples=200, deadline=None)
def test_logarithmic_times_go_up_by_one_ratio_and_end_at_the_duration(duration, part, per_decade):
    scene = explicit(
        duration=duration, samples={"per_decade": per_decade, "first": part * duration}
    )
    times, ratio = scene.times, 10 ** (1 / per_decade)
    assert times[0] == 0 and times[-1] == duration
    assert times[1] == part * duration
    assert np.all(np.diff(times) > 0)
    np.testing.assert_allclose(
        times[2:-1] / times[1:-2], ratio, rtol=1e-15 * 8
    )  # two roundings each of power, product
    assert times[-1] / times[-2] <= ratio * (1 + 1e-6)
    assert parse_scene(json.loads(scene.text), "test.yaml") == scene


def test_digests_of_the_notes_scenes_do_not_change():
    """As published with the first results: files are found by them."""
    digests = [
        read_scene(CONFIG / "scenes" / f"harrison2020{end}.yaml").digest for end in ("", "_thermal")
    ]
    assert [digest[:16] for digest in digests] == ["b6cea58f932097a2", "9c381c577af2d9a3"]
    assert explicit(samples={"per_decade": 3}).digest != explicit().digest
    assert explicit(samples={"per_decade": 3}).times[1] == 1e-4 * explicit().duration


# -- contact and overlap ---


@pytest.mark.parametrize("offset", [0.0, 1e3, -1e6])
@pytest.mark.parametrize("angle", np.linspace(0, 2 * math.pi, 9))
def test_contact_is_accepted_to_round_off(offset, angle):
    box = {"x": [offset - 3, offset + 3], "y": [-3, 3]}
    near = math.nextafter(offset + 0.2 * math.cos(angle), offset)
    assert explicit(disk(offset), disk(near, 0.2 * math.sin(angle)), box=box).particles == 2


@pytest.mark.parametrize("gap", [-1e-3, -1e-6, -1e-9, -1e-11])
def test_overlap_is_refused_beyond_round_off(gap):
    message = r"disk 0 at \[0.0, 0.0\] and disk 2 at .* overlap: the gap .* is -(1e-|0.001)"
    with pytest.raises(RequestError, match=message):
        explicit(disk(), disk(x=2.0), disk(x=0.2 + gap))


def test_wall_contact_is_accepted_to_round_off():
    assert explicit(disk(x=2.9, y=-2.9), disk(x=math.nextafter(2.9, 3), y=0)).particles == 2
    assert explicit(disk(radius=3.0, velocity=(0, 0))).particles == 1
    far = {"x": [1e6 - 3, 1e6 + 3], "y": [-3, 3]}
    assert explicit(disk(math.nextafter(1e6 + 2.9, 2e6)), box=far).particles == 1
    with pytest.raises(
        RequestError, match=r"disks\[0\].position: must .* inside the box, -2.9 <= x <= 2.9"
    ):
        explicit(disk(x=2.9 + 1e-9))


ROUND_UP = math.nextafter(1.0, 2.0)
FILLED = "touches, a disk would collide for ever"
# sides of the box, boundary, radii of tracer and bath; the key that is refused
FILLING = {
    "channel along x": ((10.0, 1.0), CHANNEL_X, 0.5, 0.5, "disks.tracer.radius"),
    "channel along y": ((1.0, 10.0), CHANNEL_Y, 0.5, 0.5, "disks.tracer.radius"),
    "walls in x": ((1.0, 10.0), "reflecting", 0.5, 0.5, "disks.tracer.radius"),
    "wide tracer": ((10.0, 1.0), CHANNEL_X, 0.5, 0.2, "disks.tracer.radius"),
    "wide bath": ((10.0, 1.0), CHANNEL_X, 0.2, 0.5, "disks.species[0].radius"),
    "rounded up": ((10.0, ROUND_UP), CHANNEL_X, 0.5, 0.5, "disks.tracer.radius"),
}


@pytest.mark.parametrize(("sides", "boundary", "tracer", "bath", "key"), FILLING.values())
def test_a_disk_as_wide_as_a_channel_with_drawn_velocities_is_refused(
    sides, boundary, tracer, bath, key
):
    """Every run would stop at t = 0."""
    width, height = sides
    box = {"x": [0, width], "y": [0, height], "boundary": boundary}
    with pytest.raises(RequestError, match=FILLED) as refused:
        species(kind(2, radius=bath), box=box, tracer={"radius": tracer, "mass": 1.0})
    assert key in str(refused.value)


def test_a_channel_hardly_wider_than_its_disks_is_accepted():
    box = {"x": [0, 10], "y": [0, 1 + 1e-9], "boundary": CHANNEL_X}
    assert species(kind(2, radius=0.5), box=box).particles == 2


def test_hard_rods_fill_a_channel_and_exchange_velocities():
    """Disks as wide as their channel that move along it alone; across it they are refused.

    Equal rods pass on their velocities, as if points of a ring of length 10 - 3 went through each
    other: the pair with relative velocity u collides u t/7 times, +- 1.
    """
    box = {"x": [0, 10], "y": [0, 1], "boundary": CHANNEL_X}
    velocities = (1.0, 0.0, -1.0)
    rods = [disk(1 + 3 * k, 0.5, 0.5, 1.0, (velocities[k], 0.0)) for k in range(3)]
    scene = explicit(*rods, box=box, duration=70.0)
    runs = simulate(scene, [0], frozenset({"none"}))
    assert not runs.observables["failed"].any()
    assert runs.observables["pair_collisions"][0] == pytest.approx((1 + 1 + 2) * 70 / 7, abs=3)
    rods[1]["velocity"] = [0.0, 1e-9]
    with pytest.raises(RequestError, match=rf"disks\[1\].radius.*{FILLED}"):
        explicit(*rods, box=box)


def lone_rod(velocity):
    """A lone tracer as wide as its channel along x."""
    return {
        "box": {"x": [0, 10], "y": [0, 1], "boundary": CHANNEL_X},
        "disks": {"tracer": {"radius": 0.5, "mass": 1.0, "velocity": velocity}},
        "velocities": {"standard_deviation": 0.0, "zero_momentum": False},
        "duration": 1.0,
    }


def test_a_tracer_as_wide_as_its_channel_may_move_along_it_alone():
    assert parse_scene(lone_rod([1.0, 0.0]), "test.yaml").particles == 1
    with pytest.raises(RequestError, match=rf"disks.tracer.radius.*{FILLED}"):
        parse_scene(lone_rod([1.0, 0.5]), "test.yaml")


def test_overlap_through_a_periodic_boundary():
    box = {"x": [0, 2], "y": [0, 2], "boundary": "periodic"}
    assert explicit(disk(0.0, 0.0), disk(1.8, 0.0), disk(0.0, 1.8), box=box).particles == 3
    for x, y in ((1.85, 0.0), (0.0, 1.85), (1.9, 1.9)):
        with pytest.raises(RequestError, match=r"disk 0 .* and disk 1 .* overlap"):
            explicit(disk(0.0, 0.0), disk(x, y), box=box)


# -- what fits ---


def test_more_disks_than_can_fit_are_refused():
    box = BOX | {"boundary": "periodic"}
    assert species(kind(1039), box=box).particles == 1039
    with pytest.raises(
        RequestError, match=r"disks: 1040 disks cover 0.907.*; must be at most 0.9069"
    ):
        species(kind(1040), box=box)
    hexagonal = {"x": [0, 2.0], "y": [0, 2 * math.sqrt(3)], "boundary": "periodic"}
    full = species(kind(200, radius=0.1), box=hexagonal)
    assert full.packing_fraction == pytest.approx(0.9069, 1e-4)


@pytest.mark.parametrize(
    ("width", "height", "boundary", "most"),
    [
        (6.0, 6.0, "reflecting", 1030),  # 2/sqrt(3) 29^2 + 29 + 29 + 1
        (2.0, 0.2 + 1e-9, "reflecting", 10),  # a row that all but fills its box
        (2.0, 0.3, "reflecting", 11),  # zigzag: 9/sqrt(1 - 0.25) + 1
        (0.3, 2.0, "reflecting", 11),
        (2.0, 0.3, CHANNEL_X, 11),  # 10/sqrt(1 - 0.25)
        (0.3, 2.0, CHANNEL_Y, 11),
        (2.0, 6.0, CHANNEL_X, 344),  # 2/sqrt(3) 10 29 + 10
    ],
)
def test_more_disks_than_can_be_between_walls_are_refused(width, height, boundary, most):
    box = {"x": [0, width], "y": [0, height], "boundary": boundary}
    assert species(kind(most, radius=0.1), box=box).particles == most
    larger = [kind(most - 1, radius=0.1), kind(1, name="small", radius=0.01)]
    assert species(*larger, box=box).particles == most
    message = (
        f"disks: {most + 1} disks of radius 0.1 or larger; must be at most {most} in this "
        f".*{width:g} x {height:g}"
    )
    with pytest.raises(RequestError, match=message):
        species(kind(most + 1, radius=0.1), box=box)
    with pytest.raises(RequestError, match=message):
        species(kind(2, radius=0.1), kind(most - 1, name="large", radius=0.1), box=box)


# -- what floating-point numbers can tell apart ---


@pytest.mark.parametrize("masses", [(1e-100, 1e100), (1e100, 1e300), (1e-300, 1e-100)])
def test_masses_up_to_a_factor_of_1e200(masses):
    """Engines: `test_extremes.test_the_largest_mass_ratio`."""
    light, heavy = masses
    assert explicit(disk(mass=light), disk(x=1, mass=heavy)).particles == 2
    assert species(kind(1, mass=1.0), kind(0, name="none", mass=1e300)).particles == 1
    with pytest.raises(
        RequestError, match=r"^test.yaml: disks: must be masses within a factor of 1e\+200, not "
    ):
        explicit(disk(mass=1.01 * heavy), disk(x=1, mass=light))


@pytest.mark.parametrize("word", ["periodic", "reflecting"])
def test_two_equal_words_for_the_axes_are_one_word(word):
    boxes = [BOX | {"boundary": boundary} for boundary in (word, {"x": word, "y": word})]
    by_word, by_axis = (species(kind(9), box=box) for box in boxes)
    assert by_axis.text == by_word.text
    assert by_axis.digest == by_word.digest
    assert by_axis.box == by_word.box


def test_channels_along_x_and_y_are_different_scenes():
    along_x = BOX | {"boundary": {"x": "periodic", "y": "reflecting"}}
    along_y = BOX | {"boundary": {"y": "periodic", "x": "reflecting"}}
    scene = species(kind(9), box=along_x)
    other = species(kind(9), box=along_y)
    assert scene.digest != other.digest
    assert scene.box != other.box
    assert repr(scene) == (
        "<Scene test: 9 disks in a channel along x, 6 x 6, packing fraction 0.007854, duration 1>"
    )
    assert scene.box.periodic_axes.tolist() == [True, False]
    again = parse_scene(json.loads(scene.text), "test.yaml")
    assert again.box == scene.box, "boxes are compared, whatever was asked of them"


def test_a_scene_with_another_value_of_a_key():
    """The keys are those of a scene file; what the user left out follows them."""
    scene = read_scene(CONFIG / "scenes" / "harrison2020.yaml")
    assert [one.count for one in scene.replace(particles=200).species] == [1, 199]
    assert scene.replace(duration=np.float64(2)).times[-1] == 2.0
    assert (
        scene.replace(equilibrate=1).equilibrate
        == scene.replace(equilibrate={"time": 1}).equilibrate
    )
    heavy = scene.replace(
        disks={"tracer": {"radius": 0.3, "mass": 3.0}, "species": scene.disks.species}
    )
    assert (heavy.mass[0], heavy.name, heavy.particles) == (3.0, scene.name, 150)
    free = scene.replace(**{"box.boundary": "periodic"}, name="free")
    assert not free.box.has_walls
    assert free.name == "free" and free != free.replace(name="other")
    along_x = {"x": "periodic", "y": "reflecting"}
    channel = scene.replace(**{"box.boundary": along_x})
    assert channel.box.is_channel and channel.replace(**{"box.boundary.y": "periodic"}) == (
        scene.replace(**{"box.boundary": "periodic"})
    )
    assert (
        scene.replace(
            **{"disks.tracer.mass": np.float64(3), "disks.species.bath.radius": 0.05}
        ).mass[0]
        == 3.0
    )
    assert scene.replace(**{"equilibrate.time": 1}) == scene.replace(equilibrate=1)
    with pytest.raises(
        RequestError, match=r"^disks.species.bat.mass: must be .* disks.species.NAME.mass"
    ):
        scene.replace(**{"disks.species.bat.mass": 2})
    assert species(kind(3)).replace(duration=0.5).sample_interval == 0.5


def test_defaults_follow_another_value_of_a_key():
    """As in a file with this value, and in another scene that a part is taken from."""
    keys = {
        "box": BOX,
        "disks": {"tracer": {"radius": 0.3, "mass": 1}, "species": [kind(9)]},
        "duration": 1,
    }
    keys |= {
        "velocities": {"temperature": 1},
        "samples": {"per_decade": 3},
        "equilibrate": {"time": 1},
    }
    scene, periodic = parse_scene(keys, "test.yaml"), BOX | {"boundary": "periodic"}
    without = {"disks": {"species": [kind(9)]}}
    new = [("box.boundary", "periodic", {"box": periodic}), ("duration", 2, {"duration": 2})]
    for path, value, part in [*new, ("disks.tracer", None, without)]:
        assert scene.replace(**{path: value}) == parse_scene(keys | part, "test.yaml")
    assert scene.replace(**{"disks.tracer": None}).equilibrate.tracer == "free"
    taken = {"velocities": scene.velocities, "equilibrate": scene.equilibrate}
    assert scene.replace(box=periodic, **taken) == scene.replace(box=periodic)
    with pytest.raises(
        RequestError, match=r"equilibrate.tracer: must be free, as there is no tracer"
    ):
        scene.replace(**{"disks.tracer": None, "equilibrate": {"time": 1, "tracer": "pinned"}})
    drift = [not species(kind(count), box=periodic).velocities.zero_momentum for count in (1, 2)]
    assert drift == [True, False]  # without it a single disk would stand still


# -- scenes with known outcomes: tests/scenes/*.yaml lead to what tests/scenes/expected.yaml says --

FOLDER = Path(__file__).parent / "scenes"
EXPECTED = yaml.load((FOLDER / "expected.yaml").read_text(), yaml.CSafeLoader)


def test_every_scene_has_an_outcome():
    assert {path.stem for path in FOLDER.glob("*.yaml")} - {"expected"} == set(EXPECTED)


@pytest.mark.parametrize("lists_from", [0.0, np.inf], ids=["lists", "cells"])
@pytest.mark.parametrize("name", EXPECTED)
def test_scene(name, lists_from, monkeypatch):
    """With neighbour lists (where they can be) and with cells alone, whatever the packing
    fraction.
    """
    monkeypatch.setattr(layout, "LISTS_FROM", lists_from)
    expected, path = EXPECTED[name], FOLDER / f"{name}.yaml"
    if "refused" in expected:
        with pytest.raises(RequestError) as refusal:
            read_scene(path)
        assert str(refusal.value).startswith(str(path))
        assert expected["refused"] in str(refusal.value)
        assert "\n" not in str(refusal.value)
        return
    scene = read_scene(path)
    result = simulate(
        scene, [0], {"tracer", "all"} | ({"events"} if "collision_time" in expected else set())
    )
    seen = {key: column[0] for key, column in result.observables.items()}
    assert not seen["failed"]
    check_counts(expected, seen)
    if "collision_time" in expected:
        assert result.events[0].time.tolist() == pytest.approx(
            [expected["collision_time"]], rel=1e-14, abs=1e-15
        )
    if expected["final"]:
        check_state(expected, result.whole[0], scene.mass)


def check_counts(expected, seen):
    for key in ("pair_collisions", "wall_collisions"):
        assert seen[key] == expected.get(key, seen[key])
    both = seen["pair_collisions"] + seen["wall_collisions"]
    assert both == expected.get("collisions", both)


def check_state(expected, track, mass):
    """The last sample against `final`, within `tolerance`."""
    position = np.array([disk["position"] for disk in expected["final"]])
    off = {"position": np.abs(track.position[-1] - position)}
    off["transverse"] = off["position"][:, 1]
    if "velocity" in expected["final"][0]:
        velocity = np.array([disk["velocity"] for disk in expected["final"]])
        off["velocity"] = np.abs(track.velocity[-1] - velocity)
        off["velocity_relative"] = off["velocity"] / (np.abs(velocity).max() or 1)
        off["transverse"] = np.concatenate([off["transverse"], off["velocity"][:, 1]])
        energy, right = (float(mass @ np.sum(v**2, axis=1)) for v in (track.velocity[-1], velocity))
        off["energy_relative"] = abs(energy - right) / (right or 1)
    for key, most in expected["tolerance"].items():
        assert np.max(off[key]) <= float(most), key  # float: YAML 1.1 takes 1e-12 for a word
