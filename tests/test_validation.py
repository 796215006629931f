"""Published results, by small versions of the studies that reproduce them; and the page of their comparisons."""

import math
import re
from pathlib import Path

import pytest

import brownpipe as bp
from brownpipe.study import read_study
from validation.catalogue import RESULTS
from validation.comparison import Comparison
from validation.page import table, value, with_table
from validation.single_runs import single_runs

ROOT = Path(__file__).parent.parent
STUDIES = ROOT / "config" / "validation"


def analysed(name, small):
    """Return the dataset, and the single runs, of a study of `config/validation` with fewer runs, or smaller ones."""
    study = read_study(STUDIES / f"{name}.yaml", small)
    asked = {"record": study.record, "observables": study.observables, "average": study.average}
    runs = [bp.simulate(case, study.seeds, **asked) for case in study.cases]
    return {name: bp.analyse(runs, fit_windows=study.fit_windows), **single_runs(name, runs)}


@pytest.mark.slow
@pytest.mark.parametrize("name", RESULTS)
def test_a_small_version_meets_what_is_published(name):
    """Within 4 standard errors: false alarm 6e-5 for each value, 0.5 % if its error is from eight runs.

    Seeds are fixed.
    """
    result = RESULTS[name]
    datasets = {name: data for study in result.studies for name, data in analysed(study, result.small[study]).items()}
    comparisons = result.compare(datasets)
    assert not [one for one in comparisons if not one.approximate and not abs(one.z) < 4]
    assert result.draw(datasets, comparisons).axes


def test_difference_in_standard_errors():
    one = Comparison("Z", 2.0, 0.3, 3.0, 0.4, "somebody")
    assert one.z == pytest.approx(2.0)
    assert one.departure == pytest.approx(0.5)
    assert not one.is_at_odds
    assert one._replace(published_error=math.nan).z == pytest.approx(2.5)
    assert one._replace(ours=3.6).is_at_odds
    assert one._replace(ours=math.nan).is_at_odds
    assert not one._replace(ours=3.6, approximate=True).is_at_odds


@pytest.mark.parametrize(
    ("number", "error", "text"),
    [
        (1.35485, 0.00021, "1.35485(21)"),
        (7.01, 0.42, "7.01(42)"),
        (0.98913, 0.00996, "0.989(10)"),
        (123.4, 9.96, "123(10)"),
        (123.4, 2.3, "123.4(2.3)"),
        (1234.5, 23.4, "1234(23)"),
        (0.25, 0.0, "0.25"),
        (0.25, math.nan, "0.25"),
    ],
)
def test_a_value_has_its_error_in_the_last_two_digits(number, error, text):
    assert value(number, error) == text


def test_a_table_replaces_that_of_its_result_alone():
    page = "a\n<!-- virial -->\nold\n<!-- end of virial -->\nb\n<!-- other -->\n<!-- end of other -->\n"
    comparisons = [Comparison("Z", 2.0, 0.3, 3.0, 0.4, "somebody")]
    written = with_table(page, "virial", comparisons, 60.0)
    assert table(comparisons) in written
    assert "old" not in written
    assert with_table(written, "virial", comparisons, 60.0) == written
    assert written.endswith("b\n<!-- other -->\n<!-- end of other -->\n")
    with pytest.raises(KeyError, match="nobody"):
        with_table(page, "nobody", comparisons, 60.0)


def test_the_page_has_a_table_and_a_figure_of_every_result():
    page = (ROOT / "docs" / "validation.md").read_text()
    tables = dict(re.findall(r"<!-- (\w+) -->\n(.*?)<!-- end of \1 -->", page, re.DOTALL))
    assert list(tables) == list(RESULTS)
    assert all("s.e." in text and "| quantity |" in text for text in tables.values())
    assert all((ROOT / "docs" / "figures" / f"validation_{name}.png").exists() for name in RESULTS)
    assert {study for result in RESULTS.values() for study in result.studies} == {
        file.stem for file in STUDIES.glob("*.yaml") if not file.stem.endswith("_large")
    }
