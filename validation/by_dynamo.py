"""The same fluid of hard disks by DynamO, another program of event-driven molecular dynamics.

    python -m validation.by_dynamo BUILD FOLDER    print the tables of docs/other_programs.md

BUILD has DynamO's programs dynamod and dynarun; FOLDER, which is made, is for its files. DynamO is three-dimensional:
disks are spheres whose z is 0 for ever, in a box four diameters high. Lengths are in diameters, the mass is 1.
"""

import argparse
import resource
import subprocess
from pathlib import Path
from time import process_time
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

import brownpipe as bp
from brownpipe.scene import Scene
from validation.comparison import Comparison
from validation.page import table

SIDE = 32  # disks along a side of the square lattice that both programs begin from
EVENTS = 500_000  # pair collisions of a run of DynamO
EQUILIBRATION = 50_000  # pair collisions before it
SEEDS = 16
FRACTIONS = (0.14, 0.5)
RATES = {0.14: 0.8, 0.5: 7.0}  # collisions per disk and time at kT = 1, roughly
TIMES = np.arange(0.5, 4.1, 0.5)  # at which positions are compared, kT = 1.5
ROUNDS = 5  # of timing, the programs in turn


class State(NamedTuple):
    """Disks of DynamO at one time."""

    position: np.ndarray  # (disk, component) [length]
    velocity: np.ndarray  # (disk, component) [length/time]
    box: np.ndarray  # (component,) sides, the centre at the origin [length]
    diameter: float


class DynamO(NamedTuple):
    """Where the programs of DynamO are, and where their files go."""

    build: Path
    folder: Path

    def run(self, program: str, *options: object) -> float:
        """Run a program in the folder; return its CPU time [s]."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [str(self.build / program), *map(str, options)]
        subprocess.run(command, cwd=self.folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def equilibrated(self, phi: float, seed: int) -> str:
        """Return the name of a file with a fluid in equilibrium; its total momentum is 0, kT = 1.5 N/(N - 1)."""
        lattice = ("-x", SIDE, "-y", SIDE, "-z", 1, "--rectangular-box", "--i1", 2, "-d", 4 * phi / np.pi)
        still = ("--zero-vel", 2, "--zero-momentum")
        self.run("dynamod", "-m", 0, *lattice, *still, "-s", seed, "-o", "lattice.xml")
        name = f"fluid-{phi}-{seed}.xml"
        self.run("dynarun", "-s", seed, "-E", "-c", EQUILIBRATION, "-o", name, "lattice.xml")
        return name

    def state(self, name: str) -> State:
        """Return the disks in a file."""
        root = ElementTree.parse(self.folder / name).getroot()
        position, velocity = (
            np.array([[float(disk.find(key).get(axis)) for axis in "xy"] for disk in root.iter("Pt")]) for key in "PV"
        )
        size = root.find("Simulation/SimulationSize")
        diameter = float(root.find("Simulation/Interactions/Interaction").get("Diameter"))
        return State(position, velocity, np.array([float(size.get("x")), float(size.get("y"))]), diameter)

    def measured(self, name: str, seed: int) -> tuple[float, float]:
        """Return Z and the collisions per disk and time, divided by the square root of kT, of a run."""
        self.run("dynarun", "-s", seed, "-c", EVENTS, "--out-data-file", "output.xml", "-o", "end.xml", name)
        state, output = self.state(name), ElementTree.parse(self.folder / "output.xml").getroot().find("Misc")
        n = len(state.position)
        kt = (state.velocity**2).sum() / 2 / (n - 1)
        size = output.find("PrimaryImageSimulationSize")
        volume = np.prod([float(size.get(axis)) for axis in "xyz"])
        virial = np.array(output.find("Pressure/InteractionContribution").text.split(), dtype=float)
        z = 1 + (virial[0] + virial[4]) / 2 * volume / (n * kt)  # xx and yy of the tensor
        events = output.find("Duration")
        rate = 2 * float(events.get("TwoParticleEvents")) / float(events.get("Time")) / n
        return z, rate / np.sqrt(kt)


def fluid(phi: float, duration: float, equilibration: float) -> Scene:
    """Return a scene of brownpipe: the same number of disks at the same density, kT = 1, momentum 0."""
    side = SIDE * np.sqrt(np.pi / 4 / phi)
    disks = {"species": [{"name": "disk", "count": SIDE**2, "radius": 0.5, "mass": 1.0}], "placement": "lattice"}
    box = {"x": [0.0, side], "y": [0.0, side], "boundary": "periodic"}
    velocities, time = {"temperature": 1.0, "zero_momentum": True}, {"time": equilibration}
    return bp.Scene(box=box, disks=disks, velocities=velocities, equilibrate=time, duration=duration)


def from_state(state: State, times: np.ndarray) -> Scene:
    """Return the scene of brownpipe that begins from a state of DynamO."""
    half = state.box / 2
    low, width = -half, 2 * half
    position = low + np.mod(state.position - low, width)
    disks = [
        {"position": place, "velocity": velocity, "radius": state.diameter / 2, "mass": 1.0}
        for place, velocity in zip(position.tolist(), state.velocity.tolist(), strict=True)
    ]
    box = {"x": [-half[0], half[0]], "y": [-half[1], half[1]], "boundary": "periodic"}
    return bp.Scene(box=box, disks=disks, duration=float(times[-1]), sample_interval=float(times[0]))


def compare_fluids(dynamo: DynamO) -> list[Comparison]:
    """Return Z and collision rate of both programs, with standard errors over runs."""
    comparisons = []
    for phi in FRACTIONS:
        theirs = np.array([dynamo.measured(dynamo.equilibrated(phi, seed), seed) for seed in range(1, SEEDS + 1)])
        duration = 2 * EVENTS / SIDE**2 / RATES[phi]
        scene = fluid(phi, duration, duration * EQUILIBRATION / EVENTS)
        found = bp.analyse(bp.simulate(scene, 2 * SEEDS, record="none", quiet=True)).squeeze()
        for k, (name, variable) in enumerate(
            {"$Z$": "compressibility", "rate": "collision_rate_at_temperature"}.items()
        ):
            ours = float(found[variable]), float(found[f"{variable}_standard_error"])
            mean, error = theirs[:, k].mean(), theirs[:, k].std(ddof=1) / np.sqrt(SEEDS)
            comparisons.append(Comparison(f"{name}, $\\phi = {phi}$", mean, error, *ours, "DynamO"))
    return comparisons


def compare_positions(dynamo: DynamO, phi: float) -> np.ndarray:
    """Return the largest distance (time,) of a disk in one program from the same in the other, from one state."""
    name = dynamo.equilibrated(phi, 1)
    start = dynamo.state(name)
    position = bp.simulate(from_state(start, TIMES), record="all", quiet=True)["disks"].position.isel(seed=0).values
    largest = []
    for k, time in enumerate(TIMES, 1):
        dynamo.run("dynarun", "-s", 1, "-f", time, "-o", "later.xml", name)
        apart = dynamo.state("later.xml").position - position[k]
        apart -= start.box * np.rint(apart / start.box)
        largest.append(np.hypot(*apart.T).max())
    return np.array(largest)


def compare_speeds(dynamo: DynamO, phi: float) -> np.ndarray:
    """Return million collisions per CPU second (round, program) of DynamO and brownpipe, from the same state."""
    name = dynamo.equilibrated(phi, 1)
    duration = 2 * EVENTS / SIDE**2 / RATES[phi]
    scene, short = (from_state(dynamo.state(name), np.array([time])) for time in (duration, duration / 1000))
    speeds = []
    for _ in range(ROUNDS):
        loading = dynamo.run("dynarun", "-s", 1, "-E", "-c", 1, "-o", "end.xml", name)
        theirs = dynamo.run("dynarun", "-s", 1, "-E", "-c", EVENTS, "-o", "end.xml", name) - loading
        seconds = []
        for each in (short, scene):
            began = process_time()
            runs = bp.simulate(each, record="none", quiet=True)
            seconds.append(process_time() - began)
        speeds.append((EVENTS / theirs, float(runs["pair_collisions"].item()) / (seconds[1] - seconds[0])))
    return np.array(speeds) / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", metavar="BUILD", type=Path)
    parser.add_argument("folder", metavar="FOLDER", type=Path)
    options = parser.parse_args()
    options.folder.mkdir(parents=True)
    dynamo = DynamO(options.build.resolve(), options.folder)
    for phi in FRACTIONS:
        largest = compare_positions(dynamo, phi)
        print(f"phi = {phi}:", ", ".join(f"{a:.1e} at {time}" for a, time in zip(largest, TIMES, strict=True)))
        speeds = compare_speeds(dynamo, phi)
        ratio = speeds[:, 1] / speeds[:, 0]
        print("  speeds", np.median(speeds, axis=0), "ratio", np.median(ratio), ratio.min(), ratio.max(), flush=True)
    print(table(compare_fluids(dynamo)))


if __name__ == "__main__":
    main()
