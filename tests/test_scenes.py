"""Scenes with known outcomes: tests/scenes/*.yaml lead to what tests/scenes/expected.yaml says, whose head explains."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from brownpipe.engines.exact import layout
from brownpipe.engines.exact.simulation import simulate
from brownpipe.errors import RequestError
from brownpipe.scene import read_scene

FOLDER = Path(__file__).parent / "scenes"
EXPECTED = yaml.load((FOLDER / "expected.yaml").read_text(), yaml.CSafeLoader)


def test_every_scene_has_an_outcome():
    assert {path.stem for path in FOLDER.glob("*.yaml")} - {"expected"} == set(EXPECTED)


@pytest.mark.parametrize("lists_from", [0.0, np.inf], ids=["lists", "cells"])
@pytest.mark.parametrize("name", EXPECTED)
def test_scene(name, lists_from, monkeypatch):
    """With neighbour lists (where they can be) and with cells alone, whatever the packing fraction."""
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
    result = simulate(scene, [0], {"tracer", "all"} | ({"events"} if "collision_time" in expected else set()))
    seen = {key: column[0] for key, column in result.observables.items()}
    assert not seen["failed"]
    check_counts(expected, seen)
    if "collision_time" in expected:
        assert result.events[0].time.tolist() == pytest.approx([expected["collision_time"]], rel=1e-14, abs=1e-15)
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
