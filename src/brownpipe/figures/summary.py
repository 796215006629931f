"""The results of a study as a short table, printed at its end, and all numbers behind it."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Collection, Iterator, Sequence
from itertools import chain, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brownpipe.analysis import diffusive, drift
from brownpipe.analysis.diffusive import EARLY
from brownpipe.analysis.goodness import FAMILY_LEVEL, holm, p_value_in_words
from brownpipe.analysis.variables import (
    FAILED,
    FOLLOWED,
    MISSING,
    SAME_TIME,
    VARIED,
    average_of,
    labels_of_cases,
)
from brownpipe.engines.ensemble import stopped_in_words
from brownpipe.figures import tradeoff
from brownpipe.figures.cases import (
    ANISOTROPIC_VARIABLES,
    COMPONENT_VARIABLES,
    SPECIES,
    SUFFIXES,
    Label,
    aligned,
    at_last_distribution,
    axis_of_diffusion,
    cases_of,
    component_of,
    diffusion_ring,
    drifts,
    estimate_of,
    has,
    label_of,
    motions_of,
    own_names,
    scene_of,
    text_of,
    title_of,
)
from brownpipe.figures.marks import power_in_words, reasons_in_words
from brownpipe.observables.average import over_origins
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.text import counted, in_lines
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

# Headings of the tests of the first two models of a dataset
TESTS = ("eq. (18), D = MSD/4t", "eq. (18), fitted D")
FIT = (
    *("window_start", "window_end", "slope", "slope_standard_error"),
    *("diffusion_coefficient", "diffusion_coefficient_standard_error"),
)
TESTED = ("chi_square", "degrees_of_freedom", "p_value", "p_value_joint")
SHAPE = ("kurtosis", "kurtosis_standard_error", "kurtosis_p_value")
SAME_DENSITY = 1e-6  # relative difference of packing fractions that are the same
D = "diffusion_coefficient"
MEDIAN = "first_passage_median"  # which has an interval alone
LINE = 100  # characters of a line of words
WIDEST = 120  # characters of a line of the table


class Quantity(NamedTuple):
    """A quantity of the answer: at the end of the runs, in the first fit window, for each species
    or pair of them.
    """

    heading: str
    variable: str
    # Variables of observables, options of the analysis, figures: any of them shows it
    asked_by: tuple[str, ...]
    # Variable with its value in theory, shown beside it in parentheses
    theory: str = ""


# Options that ask for the tests of eq. (18)
RING_OPTIONS = ("rings", "displacement_times")
MSD_REQUESTS = (
    *("diffusion_running", "fit_windows", *RING_OPTIONS),
    *("figure msd", "figure diffusion", "figure displacement_distribution", "figure scan"),
)
GREEN_KUBO = Quantity("D (Green-Kubo)", "green_kubo", ("green_kubo",), "enskog_diffusion")
QUANTITIES = (
    Quantity("energy", "species_energy", ("species_energy",)),
    Quantity(
        "Z",
        "compressibility",
        ("pair_distribution", "figure thermodynamics"),
        "enskog_compressibility",
    ),
    Quantity("g(contact)", "contact_value", ("contact_value",), "contact_theory"),
    Quantity(
        "collision rate", "collision_rate", ("figure thermodynamics",), "enskog_collision_rate"
    ),
    Quantity("|psi_6|", "orientational_order", ("orientational_order",)),
    Quantity("n(wall)", "contact_density", ("contact_density",)),
    Quantity("first passage", MEDIAN, ("first_passage_survival",)),
    Quantity("alpha_2", "non_gaussian_parameter", ("non_gaussian_parameter",)),
    GREEN_KUBO,
)
# Functions of the lag: with averages over time origins their last values have few origins.
LAG_FUNCTIONS = ("msd", "non_gaussian_parameter", "green_kubo")
DISPLACED = (
    Quantity("MSD", "msd", MSD_REQUESTS),
    Quantity("D", D, MSD_REQUESTS),
)
INTEGRALS = ("green_kubo", "component_green_kubo")
# Along x and along y where these differ
MOTION_VARIABLES = ("msd", "non_gaussian_parameter", "green_kubo", D)


class Answer(NamedTuple):
    """The results of a study, or of its trade-off, in words."""

    # Number of the first columns, which name the cases
    labels: int
    # Heading and cells; those of TESTS, the last, only if there are tests
    columns: list[tuple[str, ...]]
    # Lines that explain the columns
    legend: list[str]
    # Lines that name failed and missing seeds
    missing: list[str]
    # Lines that name cases that are not in equilibrium, or of which it cannot be told
    drifting: list[str]


def summary(dataset: Dataset, chosen: Collection[str] = (), title: str = "") -> str:
    """Return the results as a text table with one line per case, and lines below it.

    Columns beyond WIDEST are below the others, beside the names of the cases again.
    chosen: the figures that the study names. title: of the study, a line above the table.
    """
    results = answer(dataset, chosen)
    names = results.columns[: results.labels]
    tables = [[*names]]
    for column in results.columns[results.labels :]:
        widths = [max(map(len, cells)) + 2 for cells in [*tables[-1], column]]
        if sum(widths) > WIDEST + 2:
            tables.append([*names])
        tables[-1].append(column)
    lines = [title] if title else []
    for table in tables:
        lines += aligned(table)
    lines += results.legend + results.missing + results.drifting
    return in_lines(lines) + "\n"


def answer(dataset: Dataset, chosen: Collection[str] = ()) -> Answer:
    """Return the results of each scene, particle count and engine; `chosen` are the figures that
    the study names.

    The columns are what an observable, an option of the analysis or a figure asks for, or without
    any all that the dataset has, with standard errors over runs. If rings or displacement times
    were asked for, there is the verdict on eq. (18) with either D. All tests of the table are one
    family: a model is rejected at the family-wise level (Holm).
    """
    cases = cases_of(dataset)
    requests = _requests(dataset, chosen)
    columns_by_quantity = {
        quantity: [*columns_of(cases, quantity)] for quantity in quantities(dataset)
    }
    known = [quantity for quantity, columns in columns_by_quantity.items() if columns]
    shown = [quantity for quantity in known if requests & {*quantity.asked_by}] or known
    columns = _columns_of_labels(dataset, cases)
    labels = len(columns)
    columns.append(("runs", *(str(int(case.runs)) for case in cases)))
    for quantity in shown:
        for heading, parts in columns_by_quantity[quantity]:
            title = _heading_with_time(heading, parts) if quantity.variable == "msd" else heading
            columns.append((title, *(_cell(part, quantity) for part in parts)))
    tradeoff_columns = tradeoff.columns_of(cases)
    for column, cells in tradeoff_columns:
        columns.append((column.heading, *cells))
    tests = 0
    if requests & {*RING_OPTIONS}:
        p = _p_values(cases)
        tests = int(np.count_nonzero(np.isfinite(p)))
        if tests:
            columns += _columns_of_tests(p)
    legend = [*_legend(dataset, cases, shown, tests), *tradeoff.meanings_of(tradeoff_columns)]
    return Answer(labels, columns, legend, [*missing_runs(dataset, cases)], [*drifting(cases)])


def _requests(dataset: Dataset, chosen: Collection[str]) -> set[str]:
    """Return what shows quantities (`Quantity.asked_by`): the options of the analysis, the figures
    `chosen` and the variables of the dataset.
    """
    options = json.loads(dataset.attrs.get("options", "{}"))
    requests = {name for name, value in options.items() if value}
    requests |= {f"figure {name}" for name in chosen}
    for quantity in quantities(dataset):
        requests |= {name for name in quantity.asked_by if has(dataset, name)}
    return requests


def _columns_of_labels(dataset: Dataset, cases: list[Dataset]) -> list[tuple[str, ...]]:
    """Return the columns that name the cases; a single engine is not named."""
    columns = []
    for name in labels_of_cases(dataset):
        if name == "engine" and dataset.sizes["engine"] == 1:
            continue
        heading = "N" if name == "particles" else name.replace("_", " ")
        columns.append((heading, *(text_of(case, name) for case in cases)))
    if scan_changes_density(dataset, cases):
        columns.append(("phi", *(f"{case.packing_fraction.item():.4f}" for case in cases)))
    return columns


def _heading_with_time(heading: str, parts: Sequence[Dataset | None]) -> str:
    """Return the heading of an MSD, with its time if that is the same in all cases."""
    times = {part.time.item() for part in parts if part is not None}
    return f"{heading}(t = {times.pop():g})" if len(times) == 1 else f"{heading} at the end"


def _p_values(cases: list[Dataset]) -> np.ndarray:
    """Return the joint p-value of each of TESTS (cases, tests), NaN where it was not tested."""
    distributions = [at_last_distribution(case) for case in cases]
    return np.array([case.p_value_joint.values[: len(TESTS)] for case in distributions])


def _columns_of_tests(p: np.ndarray) -> list[tuple[str, ...]]:
    """Return the columns with the verdicts on eq. (18) from the p-values (cases, tests)."""
    rejected = holm(p.ravel()).reshape(p.shape) < FAMILY_LEVEL
    columns = []
    for k, heading in enumerate(TESTS):
        columns.append((heading, *map(_verdict, p[:, k], rejected[:, k])))
    return columns


def scan_changes_density(dataset: Dataset, cases: list[Dataset]) -> bool:
    """Return whether varied keys, none of them the packing fraction, change it: sizes of disks or
    of the box.
    """
    labels = labels_of_cases(dataset)
    if VARIED not in dataset.attrs or "packing_fraction" in labels:
        return False
    fractions = [case.packing_fraction.item() for case in cases]
    return max(fractions) - min(fractions) > SAME_DENSITY * max(fractions)


def quantities(dataset: Dataset) -> list[Quantity]:
    """Return all quantities that an answer may have, MSD and D last.

    An observable of the user's own is every variable with this attribute that is one number in each
    case.
    """
    numbers = []
    for name in own_names([dataset]):
        if f"{name}_standard_error" in dataset and dataset[name].dims == dataset.runs.dims:
            numbers.append(Quantity(name, name, (name,)))
    return [*QUANTITIES, *numbers, *DISPLACED]


def columns_of(
    cases: list[Dataset], quantity: Quantity
) -> Iterator[tuple[str, list[Dataset | None]]]:
    """Yield heading and cells of each column of a quantity: for each case the part with one number,
    None without it.
    """
    small_cases = [_reduced(case, quantity) for case in cases]
    if quantity.variable in MOTION_VARIABLES:
        yield from _columns_by_motion(small_cases, quantity)
        return
    dim = next((dim for dim in SPECIES if dim in small_cases[0].dims), "")
    labels = small_cases[0][dim].values.tolist() if dim else [""]
    known = {}
    for label in labels:
        labelled = [case.sel({dim: label}) if dim else case for case in small_cases]
        parts = [_at(case, quantity) for case in labelled]
        if any(parts):
            known[label] = parts
    for label, parts in known.items():
        yield f"{quantity.heading}, {label}" if len(known) > 1 else quantity.heading, parts


def _reduced(case: Dataset, quantity: Quantity) -> Dataset:
    """Return a case with what `_cell` reads, and no more: of a case with all variables each part
    takes xarray several times as long.
    """
    needed = {
        *(f"{quantity.variable}{suffix}" for suffix in SUFFIXES),
        quantity.theory,
        D,
        "diffusion_mark",
        "not_diffusive_before",
        "drift_p_value",
        "channel_axis",
        *ANISOTROPIC_VARIABLES,
    }
    needed |= {COMPONENT_VARIABLES[name] for name in needed if name in COMPONENT_VARIABLES}
    return case[[name for name in needed if name in case]]


def _columns_by_motion(
    cases: list[Dataset], quantity: Quantity
) -> Iterator[tuple[str, list[Dataset | None]]]:
    """Yield heading and cells of the columns of a quantity, such as D of all motion, and of D_x and
    D_y of cases that have these.
    """
    parts_by_axis = []
    for case in cases:
        parts = {axis_of_diffusion(part): _at(part, quantity) for part in motions_of(case)}
        parts_by_axis.append(parts)
    for axis in ("", "x", "y"):
        column = [parts.get(axis) for parts in parts_by_axis]
        if any(column):
            yield _heading_along(axis, quantity.heading), column


def _heading_along(axis: str, heading: str) -> str:
    """Return the heading of a quantity of motion along an axis; "" is all motion.

    >>> _heading_along("x", "D (Green-Kubo)"), _heading_along("", "MSD")
    ('D_x (Green-Kubo)', 'MSD')
    """
    symbol, space, remark = heading.partition(" ")
    return f"{symbol}_{axis}{space}{remark}" if axis else heading


def _at(case: Dataset, quantity: Quantity) -> Dataset | None:
    """Return the case at the time of `time_shown` and in the first window; None if it does not have
    the quantity there.

    Without a temperature the Green-Kubo integral is not a D; without an MSD nothing tells whether
    it is.
    """
    if not has(case, quantity.variable):
        return None
    if quantity.variable == "green_kubo" and not has(case, quantity.theory, D):
        return None
    places = {"window": 0}
    if "time" in case[quantity.variable].dims:
        places["time"] = time_shown(case, quantity.variable)
    part = case.isel(places, missing_dims="ignore")
    return part if has(part, quantity.variable) else None


def time_shown(case: Dataset, name: str) -> int:
    """Return the index of the time at which a function of time is shown: the last that it has.

    The Green-Kubo integral, and with averages over time origins all functions of the lag, are shown
    at the end of the first fit window: it is chosen for a D, and later there are few origins.
    """
    known = np.flatnonzero(case[name].notnull())
    if _is_shown_at_window_end(case, name):
        end = case.window_end.values[0] * (1 + SAME_TIME)
        inside = known[case.time.values[known] <= end]
        known = inside if len(inside) else known
    return int(known[-1])


def _is_shown_at_window_end(dataset: Dataset, name: str) -> bool:
    """Return whether a function of time is shown at the end of the first fit window."""
    is_of_origins = name in LAG_FUNCTIONS and over_origins(average_of(dataset))
    return name == "green_kubo" or is_of_origins


def _cell(part: Dataset | None, quantity: Quantity) -> str:
    """Return a quantity with its standard error and theory; `-` where there is none.

    A star marks values of runs that drift, a ring a D that something speaks against.
    """
    if part is None:
        return "-"
    theory = ""
    if quantity.theory and has(part, quantity.theory):
        theory = f" ({float(part[quantity.theory]):#.4g})"
    star = " *" if drifts(part) else ""
    ring = ""
    if quantity.variable == D:
        ring = diffusion_ring(part)
    elif quantity.variable == "green_kubo":
        ring = " °" if _integral_mark(part) else ""
    return estimate_of(part, quantity.variable) + theory + star + ring


def _integral_mark(part: Dataset) -> int:
    """Return the mark of the Green-Kubo integral: that of D in the window, if it begins early only
    for an integral that ends early, too.
    """
    mark = part.diffusion_mark.item() & ~EARLY
    is_early = part.time.item() < part.not_diffusive_before.item()
    return mark | (EARLY if is_early else 0)


def _integral_marks(case: Dataset) -> list[int]:
    """Return the marks of the Green-Kubo integrals of a case: of all motion, or along x and y."""
    parts = [_at(motion, GREEN_KUBO) for motion in motions_of(case)]
    return [_integral_mark(part) for part in parts if part is not None]


def _verdict(p: float, rejected: bool) -> str:
    return "-" if np.isnan(p) else f"{'' if rejected else 'not '}rejected, {p_value_in_words(p)}"


def _legend(
    dataset: Dataset, cases: list[Dataset], shown: Sequence[Quantity], tests: int
) -> Iterator[str]:
    """Lines that explain the columns, and the tests for equilibrium."""
    yield "N: number of disks. ±: one standard error over runs. All in the scene's reduced units."
    if scan_changes_density(dataset, cases):
        yield "phi: packing fraction of all disks, which changes with what is varied."
    for quantity in shown:
        if quantity.variable in MOTION_VARIABLES:
            yield from _meanings_by_motion(dataset, cases, quantity)
            continue
        variable = dataset[quantity.variable]
        meaning = _meaning_of(dataset, quantity.variable)
        source = f" ({variable.observable})" if "observable" in variable.attrs else ""
        place = _place_of(dataset, quantity.variable)
        yield from textwrap.wrap(f"{quantity.heading}: {meaning}{place}{source}.", LINE)
    for name, own in dataset.data_vars.items():
        if "observable" in own.attrs and own.dims == dataset.runs.dims:
            lacks_mean = own.isnull() & (dataset.runs > 0)
            if lacks_mean.any():
                yield f"{name}: no mean where a run has no number of it."
    if any(quantity.variable == MEDIAN for quantity in shown):
        yield "In brackets: 95 % interval, up to inf if it does not end within the runs."
    theories = [quantity.theory for quantity in shown if quantity.theory]
    if any(has(case, theory) for theory, case in product(theories, cases)):
        yield "In parentheses: theory without walls (Luding's for equal disks, else Enskog's)."
    integral_marks: list[int] = []
    if GREEN_KUBO in shown:
        for case in cases:
            integral_marks += _integral_marks(case)
    if DISPLACED[-1] in shown or any(mark & ~EARLY for mark in integral_marks):
        yield from reasons_in_words(cases)
    if DISPLACED[-1] in shown:
        yield from power_in_words(cases)
    if any(mark & EARLY for mark in integral_marks):
        yield (
            "° the Green-Kubo integral ends before 3/gamma of the tracer: it is not yet the D "
            "of diffusion."
        )
    yield from _tests_of_equilibrium(cases)
    if tests:
        yield from _tests_of_diffusion(cases, tests)


def _meaning_of(dataset: Dataset, name: str) -> str:
    """Return the meaning of a variable, with the disks over which it is averaged."""
    attribute = "velocity_autocorrelation_of" if name in INTEGRALS else "msd_of"
    followed = f"of {dataset.attrs.get(attribute, 'the tracer')}"
    return str(dataset[name].attrs.get("long_name", name)).replace(FOLLOWED, followed)


def _place_of(dataset: Dataset, name: str) -> str:
    """Return the time and the fit window at which a quantity is shown, to be appended to its
    meaning.
    """
    dims = dataset[name].dims
    place = ""
    if "time" in dims and _is_shown_at_window_end(dataset, name):
        place += f", at t = {dataset.window_end.values[0]:g}"
    elif "time" in dims:
        place += ", at the end"
    if "window" in dims:
        place += f" {dataset.window.values[0]}"
    return place


def _meanings_by_motion(
    dataset: Dataset, cases: list[Dataset], quantity: Quantity
) -> Iterator[str]:
    """Lines on a quantity such as D, and on D_x and D_y where the motion differs by axis."""
    place = _place_of(dataset, quantity.variable)
    for heading, parts in columns_of(cases, quantity):
        axis = next(axis_of_diffusion(part) for part in parts if part is not None)
        variable = COMPONENT_VARIABLES[quantity.variable] if axis else quantity.variable
        meaning = _meaning_of(dataset, variable).replace("x and y", axis)
        yield from textwrap.wrap(f"{heading}: {meaning}{place}.", LINE)


def _tests_of_diffusion(cases: list[Dataset], tests: int) -> Iterator[str]:
    """Lines on the tests of eq. (18): what is tested, at which time and level."""
    moving = [case for case in cases if has(case, "msd")]
    times = {at_last_distribution(case).displacement_time.item() for case in moving}
    at = "at the end" if len(times) > 1 else f"at t = {times.pop():g}"
    family = f"the {tests} tests of this table" if tests > 1 else "the one test of this table"
    yield f"Eq. (18): x and y {at} are normal, of variance 2Dt; tested by ring counts and kurtosis,"
    yield f"and rejected at a family-wise level of {FAMILY_LEVEL:.0%} for {family} (Holm)."


def _tests_of_equilibrium(cases: list[Dataset]) -> Iterator[str]:
    """Lines on the tests of cases that claim equilibrium: number, level, power, and what they do
    not see.
    """
    tested = [case for case in cases if has(case, "drift_p_value")]
    tests = sum(int(np.isfinite(case.drift_p_value).sum()) for case in tested)
    if not tests:
        return
    family = f"level {drift.LEVEL:.0%} for all {tests} tests (Holm)"
    power = _power_in_words(tested, tests)
    yield f"Equilibrium: the first and the last quarter of each run are compared, {family}."
    yield from textwrap.wrap(f"{power}; changes that take longer than the runs are not seen.", LINE)
    if any(has(case, "contact_value") and _has_large_pairs(case) for case in tested):
        yield from textwrap.wrap(
            "Not tested is g(r) of large disks among small ones: it settles last, as they diffuse "
            "to each other, and pressure hardly depends on it.",
            LINE,
        )


def _power_in_words(tested: Sequence[Dataset], tests: int) -> str:
    """Return the drifts that are found: of the pressure, and of the quantity that is tested
    worst.
    """
    largest: dict[str, float] = {}
    for case in tested:
        error = case.drift_standard_error.where(np.isfinite(case.drift_p_value))
        sizes = drift.found_with_power(error.values, int(case.runs), tests)
        for name, size in zip(case["quantity"].values.tolist(), sizes.tolist(), strict=True):
            if np.isfinite(size):
                largest[name] = max(largest.get(name, 0.0), size)
    rounded = {name: float(f"{100 * size:.2g}") for name, size in largest.items()}
    in_percent = {name: f"by {size:g} % of the {name}" for name, size in rounded.items()}
    worst = max(largest, key=lambda name: largest[name])
    if worst == "pressure" or "pressure" not in largest:
        return f"{drift.POWER:.0%} of drifts {in_percent[worst]} are found, of others by less"
    return (
        f"{drift.POWER:.0%} of drifts {in_percent['pressure']} are found, "
        f"and, at worst, {in_percent[worst]}"
    )


def _has_large_pairs(case: Dataset) -> bool:
    """Return whether two large disks can meet among smaller ones: then contact distances are
    three.
    """
    distances = case.contact_distance.values[np.isfinite(case.contact_value.values)]
    return len(np.unique(distances)) > 2


def drifting(cases: list[Dataset]) -> Iterator[str]:
    """Lines that name the cases, marked by a star, whose runs drift, and those where it cannot be
    told.
    """
    claimed = [case for case in cases if has(case, "time_to_try")]
    for case in filter(drifts, claimed):
        found_drift = drift.Drift(
            case["quantity"].values.tolist(),
            case["drift"].values,
            case["drift_standard_error"].values,
            case["drift_p_value"].values,
        )
        words = drift.drift_in_words(found_drift, case.time_to_try.item())
        yield f"* {scene_of(case)}, N = {case.particles.item()}: {words}"
    untested = [title_of(case) for case in claimed if not has(case, "drift_p_value")]
    if untested:
        others = f" and {len(untested) - 1} more" if len(untested) > 1 else ""
        yield f"{untested[0]}{others}: {drift.TOO_FEW}"


def missing_runs(dataset: Dataset, cases: list[Dataset]) -> Iterator[str]:
    """Lines that name the seeds whose runs failed or are missing, why runs could not go on, and the
    risk of a bias.
    """
    if "run_status" in dataset:
        yield from _missing_seeds(dataset, cases)
    failed = sum(int(case.failed_runs) for case in cases)
    if failed:
        runs = counted(failed, "failed run")
        yield (
            f"The averages leave out {runs}; they are biased if runs that fail differ from the "
            "others."
        )


def _missing_seeds(dataset: Dataset, cases: list[Dataset]) -> Iterator[str]:
    """Lines that name the seeds whose runs failed or are missing, and why runs could not go on.

    Missing are seeds from the first to the last of the same engine: engines may have seeds of their
    own.
    """
    is_there = dataset.run_status != MISSING
    is_of_engine = is_there.any([dim for dim in is_there.dims if dim not in ("engine", "seed")])
    for case in cases:
        run = is_of_engine.sel(engine=case.engine).values
        from_first = np.logical_or.accumulate(run)
        to_last = np.logical_or.accumulate(run[::-1])[::-1]
        requested = from_first & to_last
        for status, fate in ((FAILED, "failed and left out"), (MISSING, "missing")):
            seeds = case.seed.values[(case.run_status.values == status) & requested]
            if seeds.size:
                number = np.count_nonzero(requested)
                words = f"{seeds.size} of {number} seeds ({brief_seed_text(seeds)})"
                reasons = _reasons_in_words(case) if status == FAILED else ""
                yield f"{title_of(case)}: {fate}: {words}{reasons}"


def _reasons_in_words(case: Dataset) -> str:
    """Return why runs of a case could not go on, to be appended to a line; "" if all could."""
    if "stopped" not in case:
        return ""
    reasons = zip(case.seed.values.tolist(), case.stopped.values.tolist(), strict=True)
    stopped = {seed: reason for seed, reason in reasons if reason}
    return f"; {stopped_in_words(stopped)}" if stopped else ""


def summary_table(dataset: Dataset) -> DataFrame:
    """Return every number that an answer may have, and those of the other fit windows: one row per
    case, axis with a D of its own, and window; of a trade-off one row per case.
    """
    from pandas import DataFrame

    cases = cases_of(dataset)
    if is_tradeoff(dataset):
        return DataFrame([label_of(case, *map(str, case.data_vars)) for case in cases])
    measured: list[tuple[Quantity, str, list[Dataset | None]]] = []
    motion_quantities = []
    for quantity in dict.fromkeys([*DISPLACED, *quantities(dataset)]):  # the MSD first
        columns = [*columns_of(cases, quantity)]
        if quantity.variable not in MOTION_VARIABLES:
            measured += [(quantity, *column) for column in columns]
        elif columns and quantity.variable != D:
            motion_quantities.append(quantity)
    motions = [motions_of(case) for case in cases]
    has_components = any(map(component_of, chain(*motions)))
    rows = []
    for k, case in enumerate(cases):
        row = label_of(case, "packing_fraction", "runs", "failed_runs")
        row |= {
            "duration": case.duration.item(),
            "not_diffusive_before": case.not_diffusive_before.item(),
            "drifts": drifts(case),
        }
        numbers_of_case: dict[str, Label] = {}
        for quantity, heading, parts in measured:
            column = heading.replace(quantity.heading, quantity.variable)
            numbers_of_case |= _numbers_of(parts[k], quantity.variable, column)
        last = at_last_distribution(case)
        numbers_of_case |= {name: last[name].item() if name in last else np.nan for name in SHAPE}
        for model, test in product(dataset.model.values, TESTED):
            numbers_of_case[f"{test}, {model}"] = last[test].sel(model=model).item()
        for motion in motions[k]:
            row_of_motion = row.copy()
            for quantity in motion_quantities:
                name = quantity.variable
                row_of_motion |= _numbers_of(_at(motion, quantity), name, name)
            row_of_motion |= numbers_of_case
            if has_components:
                row_of_motion["component"] = axis_of_diffusion(motion)
            for w in range(case.sizes["window"]):
                fit = motion.isel(window=w)
                numbers = {name: fit[name].item() for name in FIT}
                mark = diffusive.mark_in_words(fit.diffusion_mark.item())
                rows.append(row_of_motion | numbers | {"mark": mark})
    return DataFrame(rows)


def _numbers_of(part: Dataset | None, name: str, column: str) -> dict[str, Label]:
    """Return columns of a table: a variable of a part of a case with its standard error, or with
    its 95 % interval if it has only that, and for a function of the lag the time at which it is
    shown. All are NaN if there is no part.
    """
    uncertainties = ["_low", "_high"] if name == MEDIAN else ["_standard_error"]
    numbers: dict[str, Label] = {}
    for suffix in ("", *uncertainties):
        numbers[f"{column}{suffix}"] = np.nan if part is None else part[f"{name}{suffix}"].item()
    if name in LAG_FUNCTIONS:
        numbers[f"{column}_time"] = np.nan if part is None else part.time.item()
    return numbers
