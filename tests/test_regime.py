"""The centre of mass at rest, and fit windows after the tracer's velocity has decayed."""

import numpy as np
import pytest

import brownpipe as bp
from brownpipe import theory
from brownpipe.engines import friction
from brownpipe.engines.windows import default_windows
from brownpipe.figures.summary import summary
from brownpipe.scene import motion
from brownpipe.scene.reading import yaml_text
from brownpipe.study.check import describe_scene_or_study

TRACER = {"radius": 0.5, "mass": 8.0}
BATH = {"name": "bath", "count": 24, "radius": 0.2, "mass": 1.0}
THIN = {"radius": 0.02, "mass": 50.0}


def scene(boundary="periodic", velocities=None, **keys):
    given = {
        "box": {"x": [0, 8], "y": [0, 8], "boundary": boundary},
        "disks": {"tracer": TRACER, "species": [BATH]},
        "velocities": velocities or {"temperature": 1.5},
        "equilibrate": {"time": 1.0, "tracer": "free"},
        "duration": 4.0,
        "sample_interval": 0.2,
        "name": "regime",
    }
    return bp.Scene(**(given | keys))


@pytest.mark.parametrize(
    ("boundary", "disks", "asked", "found"),
    [
        ("periodic", {"species": [BATH]}, None, True),
        ("periodic", {"species": [BATH]}, False, False),
        ("periodic", {"species": [BATH | {"count": 1}]}, None, False),  # it would stand still
        ("reflecting", {"species": [BATH]}, None, False),
        ("reflecting", {"species": [BATH]}, True, True),
    ],
)
def test_the_centre_of_mass_rests_in_a_periodic_box_unless_asked_otherwise(
    boundary, disks, asked, found
):
    velocities = {"temperature": 1.0} | ({} if asked is None else {"zero_momentum": asked})
    one, rests = scene(boundary, velocities, disks=disks), found and boundary == "periodic"
    assert one.velocities.zero_momentum is found
    assert motion.moving_disks(one) == one.particles - rests  # walls give momentum back
    assert (motion.bath_share(one) < 1) == rests


@pytest.mark.parametrize("start", [0.0, {"time": 100.0, "tracer": "pinned"}])
@pytest.mark.parametrize("mass", [8.0, 0.1])
@pytest.mark.parametrize("width", [{"temperature": 1.5}, {"standard_deviation": 0.7}])
def test_the_drift_of_the_centre_of_mass_is_that_of_the_disks_at_the_start(width, mass, start):
    bath = [
        BATH | {"count": 3, "radius": 0.8},
        BATH | {"name": "heavy", "count": 1, "radius": 0.8, "mass": 4.0},
    ]
    disks = {"tracer": TRACER | {"mass": mass}, "species": bath}
    free = scene(
        velocities=width | {"zero_momentum": False}, equilibrate=start, disks=disks, duration=0.2
    )
    found = bp.simulate(free, seeds=1000, record="all", quiet=True)["disks"].isel(time=0)
    square = (((found.velocity * found.mass).sum("disk") / found.mass.sum()) ** 2).sum("component")
    error = float(square.std()) / np.sqrt(len(square))
    assert abs(square.mean() - 2 * friction.drift_diffusion(free) / free.duration) < 4 * error


def test_check_says_what_the_centre_of_mass_does_to_d(tmp_path):
    def line(momentum):
        velocities = {"temperature": 1.5, "zero_momentum": momentum}
        (tmp_path / "one.yaml").write_text(yaml_text(scene(velocities=velocities).as_mapping()))
        text = describe_scene_or_study(str(tmp_path / "one.yaml"))
        return next(line for line in text.splitlines() if line.startswith("momentum"))

    assert "D is (1 - m/M)^2 = 0.562 times" in line(True)  # 24^2/32^2
    expected = 1.5 / 8 / friction.friction_rate(scene(), "enskog")
    assert f"adds 0.19 to a D of {expected:.2g} " in line(False)  # kT t/M = 1.5 * 4/32


@pytest.mark.filterwarnings("ignore:.*langevin is rough here")
def test_the_engines_own_friction_says_when_motion_is_diffusive_and_an_integral_before_is_marked():
    asked = {
        "engine": "langevin",
        "friction": "boltzmann",
        "observables": ["velocity_autocorrelation"],
    }
    drifting = scene(duration=1.0, velocities={"temperature": 1.5, "zero_momentum": False})
    runs = bp.simulate(drifting, 8, **asked)
    result = bp.analyse(runs)
    assert "drift_diffusion" not in result, "the tracer has no other disks to drift with"
    early = result.not_diffusive_before.item()
    assert early == pytest.approx(3 / runs.friction_rate.values[0])
    assert early > 1.05 * friction.not_diffusive_before(drifting)
    assert "\n° the Green-Kubo integral ends before 3/gamma of the tracer" in summary(result)


def test_windows_begin_when_the_initial_velocity_is_forgotten(tmp_path):
    long = scene(duration=40.0)
    start = friction.not_diffusive_before(long)
    assert start == pytest.approx(3 * 24 / 32 / friction.friction_rate(scene(), "enskog"))
    faster = scene(duration=50.0, disks={"tracer": TRACER | {"mass": 1.0}, "species": [BATH]})
    assert default_windows([faster, long]) == tuple(
        (pytest.approx(k * start, rel=0.05), 40.0) for k in (1, 2)
    )
    packed = {"species": [BATH | {"count": 400}], "placement": "lattice"}
    crystal = scene(disks=packed)  # packing fraction 0.785
    assert friction.partners_of(crystal).contact_value == pytest.approx([theory.contact_value(0.7)])
    alone = scene(disks={"tracer": TRACER})
    assert friction.not_diffusive_before(alone) == np.inf
    assert default_windows([alone]) == ((0.4, 4), (2, 4))
    late = scene(disks={"tracer": THIN, "species": [BATH]})
    assert default_windows([late]) == ((2, 4), (3, 4))
    (tmp_path / "one.yaml").write_text(yaml_text(late.as_mapping()))
    caution = "caution   the fit window [2, 4] begins before 3/gamma"
    assert caution in describe_scene_or_study(str(tmp_path / "one.yaml"))
