"""What a page and `inspect` say of the scenes of a dataset."""

import json

import brownpipe as bp
from brownpipe.report.description import setup_in_words

BOX = {"x": [0, 7], "y": [0, 5]}
TRACER = {"radius": 0.45, "mass": 8.0, "position": [3.5, 2.0]}
BATH = {"name": "bath", "count": 14, "radius": 0.2, "mass": 0.5}


def scene(name="s", boundary="reflecting", **keys):
    disks = {"tracer": TRACER, "species": [BATH]}
    given = {
        "box": BOX | {"boundary": boundary},
        "disks": disks,
        "velocities": {"standard_deviation": 1.5},
        "duration": 0.6,
        "sample_interval": 0.2,
    }
    return bp.Scene(name=name, **(given | keys))


def described(*scenes, **options):
    runs = [bp.simulate(one, options.pop("seeds", 3), quiet=True) for one in scenes]
    return setup_in_words(bp.analyse(runs, quiet=True))


def test_one_scene_is_a_paragraph():
    assert described(scene()) == [
        "15 disks in a box 7 x 5 with reflecting walls, packing fraction 0.06844: 1 tracer "
        "(radius 0.45, mass 8, starts at (3.5, 2)), 14 bath (radius 0.2, mass 0.5). Start: placed "
        "at random. Initial velocities: normal, standard deviation 1.5 of each component. A run: "
        "from t = 0 to 0.6, 4 samples. 3 runs by the engine exact; seeds 0-2."
    ]


def test_a_channel_is_named_with_its_axis():
    """Its total momentum is zero along that axis by default."""
    (words,) = described(scene(boundary={"x": "reflecting", "y": "periodic"}))
    assert words.startswith("15 disks in a channel along y, 7 x 5, packing fraction 0.06844: ")
    assert "standard deviation 1.5 of each component; the total momentum along y is zero." in words


def test_what_scenes_share_is_said_once():
    hot = scene("hot", velocities={"temperature": 3}, equilibrate={"time": 0.5})
    shared, cold, warm = described(scene("cold"), hot)
    assert shared.startswith("All scenes: 15 disks in a box 7 x 5 with reflecting walls")
    assert shared.endswith("4 samples. 3 runs of each case by the engine exact; seeds 0-2.")
    start = "Start: placed at random, then equilibrated for 0.5 with the tracer pinned"
    assert cold.startswith("cold: Start: placed at random. Initial velocities: normal, standard")
    assert warm == (
        f"hot: {start}, which is not equilibrium. Initial velocities: normal, temperature kT = 3."
    )


def test_listed_disks():
    disks = [{"position": [1, 1], "velocity": [1, 0], "radius": 0.3, "mass": 1}]
    listed = bp.Scene(box=BOX | {"boundary": "periodic"}, disks=disks, duration=2)
    (words,) = described(listed, seeds=1)
    assert words.startswith(
        "1 disk in a periodic box 7 x 5, packing fraction 0.008078: 1 kind-1 (radius 0.3, mass 1, "
        "starts at (1, 1))."
    )
    assert "Start: at given places. Initial velocities: given." in words


def test_of_a_scan_the_first_scene_and_what_varies():
    keys = {"disks.tracer.mass": [2, 4, 9], "disks.tracer.radius": [0.3, 0.4, 0.5]}
    runs = bp.scan(scene(), keys, seeds=2, together=True, quiet=True)
    (words,) = setup_in_words(runs)
    assert words.startswith(
        "Varied: disks.tracer.mass = 2, 4, 9 together with disks.tracer.radius = 0.3, 0.4, 0.5; "
        "described is the first of them. 15 disks in"
    )
    assert "1 tracer (radius 0.3, mass 2, starts at" in words
    assert words.endswith("2 runs of each case by the engine exact; seeds 0-1.")


def test_of_several_numbers_of_disks_the_first_and_all_numbers():
    species = [BATH | {"count": "rest"}]
    crowds = [scene(particles=n, disks={"tracer": TRACER, "species": species}) for n in (9, 15)]
    (words,) = described(*crowds)
    assert words.startswith(
        "Varied: number of disks = 9, 15; described is the first of them. 9 disks in a box"
    )


def test_a_dataset_that_does_not_name_its_scenes_has_no_words_on_them():
    result = bp.analyse(bp.simulate(scene(), 2, quiet=True), quiet=True)
    (record,) = json.loads(result.made_from)
    del record["name"]
    assert setup_in_words(result.assign_attrs(made_from=json.dumps([record]))) == []
    assert setup_in_words(result.drop_attrs()) == []
