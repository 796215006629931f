"""The results of a study as a short table, printed at its end, and all numbers behind it."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brownpipe.analysis import diffusive, drift
from brownpipe.analysis.diffusive import EARLY
from brownpipe.analysis.goodness import FAMILY_LEVEL, holm, in_words
from brownpipe.analysis.variables import (
    FAILED,
    FOLLOWED,
    MISSING,
    SAME_TIME,
    VARIED,
    labels_of_cases,
)
from brownpipe.engines.ensemble import stopped_in_words
from brownpipe.figures.cases import (
    SPECIES,
    aligned,
    at_last_distribution,
    cases_of,
    diffusion_ring,
    drifts,
    estimate_of,
    has,
    label_of,
    own_names,
    scene_of,
    text_of,
    title_of,
)
from brownpipe.figures.marks import power_in_words, reasons_in_words
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.text import counted, in_lines

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

TESTS = ("eq. (18), D = MSD/4t", "eq. (18), fitted D")  # of the first two models of a dataset
FIT = (
    *("window_start", "window_end", "slope", "slope_standard_error"),
    *("diffusion_coefficient", "diffusion_coefficient_standard_error"),
)
TESTED = ("chi_square", "degrees_of_freedom", "p_value", "p_value_joint")
SHAPE = ("kurtosis", "kurtosis_standard_error", "kurtosis_p_value")
SAME_DENSITY = 1e-6  # relative difference of packing fractions that are the same
LINE = 100  # characters of a line of words
WIDEST = 120  # characters of a line of the table


class Quantity(NamedTuple):
    """A quantity of the answer: at the end of the runs, in the first fit window, for each species
    or pair of them.
    """

    heading: str
    variable: str
    asked_by: tuple[
        str, ...
    ]  # variables of observables, options of the analysis, figures: any of them shows it
    theory: str = ""  # variable with its value in theory, shown beside it in parentheses


OF_RINGS = ("rings", "displacement_times")  # options that ask for the tests of eq. (18)
OF_SPREADING = (
    *("diffusion_running", "fit_windows", *OF_RINGS),
    *("figure msd", "figure diffusion", "figure displacement_distribution", "figure scan"),
)
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
    Quantity("alpha_2", "non_gaussian_parameter", ("non_gaussian_parameter",)),
    Quantity("D (Green-Kubo)", "green_kubo", ("green_kubo",), "enskog_diffusion"),
)
# Functions of the lag: with averages over time origins their last values have few origins.
OF_LAG = ("msd", "non_gaussian_parameter", "green_kubo")
DISPLACED = (
    Quantity("MSD", "msd", OF_SPREADING),
    Quantity("D", "diffusion_coefficient", OF_SPREADING),
)


class Answer(NamedTuple):
    """The results of a study in words."""

    labels: int  # number of the first columns, which name the cases
    columns: list[
        tuple[str, ...]
    ]  # heading and cells; those of TESTS, the last, only if there are tests
    legend: list[str]  # lines that explain the columns
    missing: list[str]  # lines that name failed and missing seeds
    drifting: list[
        str
    ]  # lines that name cases that are not in equilibrium, or of which it cannot be told


def summary(dataset: Dataset, chosen: Collection[str] = (), title: str = "") -> str:
    """Return the results as a text table with one line per case, and lines below it.

    Columns beyond WIDEST are below the others, beside the names of the cases again.
    chosen: the figures that the study names. title: of the study, a line above the table.
    """
    found = answer(dataset, chosen)
    names = found.columns[: found.labels]
    blocks = [[*names]]
    for column in found.columns[found.labels :]:
        if sum(max(map(len, cells)) + 2 for cells in [*blocks[-1], column]) > WIDEST + 2:
            blocks.append([*names])
        blocks[-1].append(column)
    table = [line for block in blocks for line in aligned(block)]
    return (
        in_lines(
            [*([title] if title else []), *table, *found.legend, *found.missing, *found.drifting]
        )
        + "\n"
    )


def answer(dataset: Dataset, chosen: Collection[str] = ()) -> Answer:
    """Return the results of each scene, particle count and engine; `chosen` are the figures that
    the study names.

    The columns are what an observable, an option of the analysis or a figure asks for, or without
    any all that the dataset has, with standard errors over runs. If rings or displacement times
    were asked for, there is the verdict on eq. (18) with either D. All tests of the table are one
    family: a model is rejected at the family-wise level (Holm).
    """
    cases = cases_of(dataset)
    options = json.loads(dataset.attrs.get("options", "{}"))
    given = {name for name, value in options.items() if value} | {
        f"figure {name}" for name in chosen
    }
    of_quantity = {one: [*columns_of(cases, one)] for one in quantities(dataset)}
    given |= {name for one in of_quantity for name in one.asked_by if has(dataset, name)}
    known = [one for one, found in of_quantity.items() if found]
    shown = [one for one in known if given & {*one.asked_by}] or known
    p = np.array([at_last_distribution(case).p_value_joint.values[: len(TESTS)] for case in cases])
    p = p if given & {*OF_RINGS} else np.full_like(p, np.nan)
    rejected = holm(p.ravel()).reshape(p.shape) < FAMILY_LEVEL
    tests = int(np.count_nonzero(np.isfinite(p)))
    ends = {float(case.time[time_shown(case, "msd")]) for case in cases if has(case, "msd")}
    end = f"MSD(t = {ends.pop():g})" if len(ends) == 1 else "MSD at the end"
    names = [
        name for name in labels_of_cases(dataset) if name != "engine" or dataset.sizes["engine"] > 1
    ]
    headings = ["N" if name == "particles" else name.replace("_", " ") for name in names]
    columns = [
        (head, *(text_of(case, name) for case in cases))
        for head, name in zip(headings, names, strict=True)
    ]
    if scan_changes_density(dataset, cases):
        columns.append(("phi", *(f"{case.packing_fraction.item():.4f}" for case in cases)))
    labels = len(columns)
    columns.append(("runs", *(str(int(case.runs)) for case in cases)))
    for one in shown:
        for heading, parts in of_quantity[one]:
            columns.append(
                (end if one.variable == "msd" else heading, *(_cell(part, one) for part in parts))
            )
    if tests:
        columns += [(name, *map(_verdict, p[:, k], rejected[:, k])) for k, name in enumerate(TESTS)]
    legend = [*_legend(dataset, cases, shown, tests)]
    return Answer(labels, columns, legend, [*missing_runs(dataset, cases)], [*drifting(cases)])


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
    own = own_names([dataset])
    numbers = [
        name
        for name in own
        if f"{name}_standard_error" in dataset and dataset[name].dims == dataset.runs.dims
    ]
    return [*QUANTITIES, *(Quantity(name, name, (name,)) for name in numbers), *DISPLACED]


def columns_of(cases: list[Dataset], one: Quantity) -> Iterator[tuple[str, list[Dataset | None]]]:
    """Yield heading and cells of each column of a quantity: for each case the part with one number,
    None without it.
    """
    needed = {
        one.variable,
        f"{one.variable}_standard_error",
        one.theory,
        "diffusion_mark",
        "not_diffusive_before",
        "drift_p_value",
    }
    # What `_cell` reads, and no more: of a case with all variables each part takes xarray several
    # times as long.
    cases = [case[[name for name in needed if name in case]] for case in cases]
    dim = next((dim for dim in SPECIES if dim in cases[0].dims), "")
    labels = cases[0][dim].values.tolist() if dim else [""]
    parts = {
        label: [_at(case.sel({dim: label}) if dim else case, one) for case in cases]
        for label in labels
    }
    known = {label: of_label for label, of_label in parts.items() if any(of_label)}
    for label, of_label in known.items():
        yield f"{one.heading}, {label}" if len(known) > 1 else one.heading, of_label


def _at(case: Dataset, one: Quantity) -> Dataset | None:
    """Return the case at the time of `time_shown` and in the first window; None if it does not have
    the quantity there.

    Without a temperature, the Green-Kubo integral is not a D.
    """
    if not has(case, one.variable) or (one.variable == "green_kubo" and not has(case, one.theory)):
        return None
    values, places = case[one.variable], {"window": 0}
    if "time" in values.dims:
        places["time"] = time_shown(case, one.variable)
    part = case.isel(places, missing_dims="ignore")
    return part if has(part, one.variable) else None


def time_shown(case: Dataset, name: str) -> int:
    """Return the index of the time at which a function of time is shown: the last that it has.

    The Green-Kubo integral, and with averages over time origins all functions of the lag, are shown
    at the end of the first fit window: it is chosen for a D, and later there are few origins.
    """
    known = np.flatnonzero(case[name].notnull())
    if name == "green_kubo" or (name in OF_LAG and case.attrs.get("average") == "origins"):
        end = case.window_end.values[0] * (1 + SAME_TIME)
        inside = known[case.time.values[known] <= end]
        known = inside if len(inside) else known
    return int(known[-1])


def _cell(part: Dataset | None, one: Quantity) -> str:
    """Return a quantity with its standard error and theory; `-` where there is none.

    A star marks values of runs that drift, a ring a D that something speaks against.
    """
    if part is None:
        return "-"
    theory = f" ({float(part[one.theory]):#.4g})" if one.theory and has(part, one.theory) else ""
    star = " *" if drifts(part) else ""
    ring = ""
    if one.variable == "diffusion_coefficient":
        ring = diffusion_ring(part)
    elif one.variable == "green_kubo":
        ring = " °" if _integral_mark(part) else ""
    return estimate_of(part, one.variable) + theory + star + ring


def _integral_mark(part: Dataset) -> int:
    """Return the mark of the Green-Kubo integral: that of D in the window, if it begins early only
    for an integral that ends early, too.
    """
    mark = part.diffusion_mark.item() & ~EARLY
    is_early = part.time.item() < part.not_diffusive_before.item()
    return mark | (EARLY if is_early else 0)


def _integral_ends_early(case: Dataset) -> bool:
    """Return whether the Green-Kubo integral is shown at a time at which it may not be a D yet."""
    integral = next(one for one in QUANTITIES if one.variable == "green_kubo")
    part = _at(case, integral)
    return part is not None and bool(_integral_mark(part) & EARLY)


def _verdict(p: float, rejected: bool) -> str:
    return "-" if np.isnan(p) else f"{'' if rejected else 'not '}rejected, {in_words(p)}"


def _legend(
    dataset: Dataset, cases: list[Dataset], shown: Sequence[Quantity], tests: int
) -> Iterator[str]:
    """Lines that explain the columns, and the tests for equilibrium."""
    yield "N: number of disks. ±: one standard error over runs. All in the scene's reduced units."
    if scan_changes_density(dataset, cases):
        yield "phi: packing fraction of all disks, which changes with what is varied."
    followed = f"of {dataset.attrs.get('msd_of', 'the tracer')}"
    where = {"time": ", at the end", "window": f" {dataset.window.values[0]}"}
    at_window_end = {"time": f", at t = {dataset.window_end.values[0]:g}"}
    for one in shown:
        variable = dataset[one.variable]
        meaning = variable.attrs.get("long_name", one.variable).replace(FOLLOWED, followed)
        source = f" ({variable.observable})" if "observable" in variable.attrs else ""
        is_at_window_end = one.variable == "green_kubo" or (
            one.variable in OF_LAG and dataset.attrs.get("average") == "origins"
        )
        places = where | at_window_end if is_at_window_end else where
        place = "".join(places.get(str(dim), "") for dim in variable.dims)
        yield from textwrap.wrap(f"{one.heading}: {meaning}{place}{source}.", LINE)
    for name, own in dataset.data_vars.items():
        if (
            "observable" in own.attrs
            and own.dims == dataset.runs.dims
            and (own.isnull() & (dataset.runs > 0)).any()
        ):
            yield f"{name}: no mean where a run has no number of it."
    if any(one.theory and has(case, one.theory) for one in shown for case in cases):
        yield "In parentheses: theory without walls (Luding's for equal disks, else Enskog's)."
    if DISPLACED[-1] in shown:
        yield from reasons_in_words(cases)
        yield from power_in_words(cases)
    if any(one.variable == "green_kubo" for one in shown):
        early = [case for case in cases if _integral_ends_early(case)]
        if early:
            yield (
                "° the Green-Kubo integral ends before 3/gamma of the tracer: it is not yet the D "
                "of diffusion."
            )
    yield from _tests_of_equilibrium(cases)
    if tests:
        times = {
            at_last_distribution(case).displacement_time.item()
            for case in cases
            if has(case, "msd")
        }
        at = "at the end" if len(times) > 1 else f"at t = {times.pop():g}"
        family = f"the {tests} tests of this table" if tests > 1 else "the one test of this table"
        yield (
            f"Eq. (18): x and y {at} are normal, of variance 2Dt; tested by ring counts and "
            "kurtosis,"
        )
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
    yield f"Equilibrium: the first and the last quarter of each run are compared, {family}."
    yield from textwrap.wrap(
        f"{_power_in_words(tested, tests)}; changes that take longer than the runs are not seen.",
        LINE,
    )
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
        values = (case[name].values for name in ("drift", "drift_standard_error", "drift_p_value"))
        found = drift.Drift(case["quantity"].values.tolist(), *values)
        words = drift.in_words(found, case.time_to_try.item())
        yield f"* {scene_of(case)}, N = {case.particles.item()}: {words}"
    unknown = [title_of(case) for case in claimed if not has(case, "drift_p_value")]
    if unknown:
        yield (
            f"{unknown[0]}{f' and {len(unknown) - 1} more' if len(unknown) > 1 else ''}: "
            f"{drift.TOO_FEW}"
        )


def missing_runs(dataset: Dataset, cases: list[Dataset]) -> Iterator[str]:
    """Lines that name the seeds whose runs failed or are missing, why runs could not go on, and the
    risk of a bias.

    Missing are seeds from the first to the last of the same engine: engines may have seeds of their
    own.
    """
    is_there = dataset.run_status != MISSING
    of_engine = is_there.any([dim for dim in is_there.dims if dim not in ("engine", "seed")])
    for case in cases:
        run = of_engine.sel(engine=case.engine).values
        asked = np.logical_or.accumulate(run) & np.logical_or.accumulate(run[::-1])[::-1]
        for status, fate in ((FAILED, "failed and left out"), (MISSING, "missing")):
            seeds = case.seed.values[(case.run_status.values == status) & asked]
            if seeds.size:
                reasons = (
                    case.stopped.values.tolist() if status == FAILED and "stopped" in case else ()
                )
                stopped = {
                    seed: why
                    for seed, why in zip(case.seed.values.tolist(), reasons, strict=False)
                    if why
                }
                reason = f"; {stopped_in_words(stopped)}" if stopped else ""
                which = (
                    f"{seeds.size} of {np.count_nonzero(asked)} seeds ({brief_seed_text(seeds)})"
                )
                yield f"{title_of(case)}: {fate}: {which}{reason}"
    if failed := sum(int(case.failed_runs) for case in cases):
        runs = counted(failed, "failed run")
        yield (
            f"The averages leave out {runs}; they are biased if runs that fail differ from the "
            "others."
        )


def summary_table(dataset: Dataset) -> DataFrame:
    """Return every number that an answer may have, and those of the other fit windows: one row per
    case and window.
    """
    from pandas import DataFrame

    rows, cases = [], cases_of(dataset)
    shown = [DISPLACED[0], *quantities(dataset)[:-1]]  # D, the last, is one of the fits
    measured = [(one, *column) for one in shown for column in columns_of(cases, one)]
    for k, case in enumerate(cases):
        row = label_of(case, "packing_fraction", "runs", "failed_runs")
        row |= {
            "time": case.duration.item(),
            "not_diffusive_before": case.not_diffusive_before.item(),
            "drifts": drifts(case),
        }
        for one, heading, parts in measured:
            for end in ("", "_standard_error"):
                value = parts[k][one.variable + end].item() if parts[k] is not None else np.nan
                row[heading.replace(one.heading, one.variable) + end] = value
        last = at_last_distribution(case)
        row |= {name: last[name].item() if name in last else np.nan for name in SHAPE}
        of_models = [(test, model) for model in dataset.model.values for test in TESTED]
        row |= {f"{test}, {model}": last[test].sel(model=model).item() for test, model in of_models}
        for w in range(case.sizes["window"]):
            fit = case.isel(window=w)
            numbers = {name: fit[name].item() for name in FIT}
            rows.append(row | numbers | {"mark": diffusive.in_words(fit.diffusion_mark.item())})
    return DataFrame(rows)
