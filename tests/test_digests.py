"""What a result is made with: no source file that decides it is missing from its digest."""

import pytest

from brownpipe import provenance
from brownpipe.engines import DEFINITIONS
from test_architecture import needed_by

CASES = [*(("simulate", engine) for engine in DEFINITIONS), ("aggregate", None), ("tradeoff", None), ("figures", None)]
SILENT = (  # what a step imports and what decides no number and no byte of its output
    *("progress.py", "stages.py", "processes.py"),  # progress, processes and signals
    *("errors.py", "quoting.py", "formatting.py", "provenance.py"),  # messages
    *(f"engines/{engine}/__init__.py" for engine in DEFINITIONS),  # refusals; settings are arguments
    "figures/catalogue.py",  # names that a study may have
)
MAKERS = {  # what makes and writes the results of a step
    "simulate": ("brownpipe.engines.ensemble", "brownpipe.scene.variation", "brownpipe.storage.trajectories"),
    "aggregate": ("brownpipe.analysis", "brownpipe.storage.datasets"),
    "tradeoff": ("brownpipe.tradeoff", "brownpipe.storage.datasets"),
    "figures": ("brownpipe.report.products",),
}


def names(files):
    return {file.relative_to(provenance.PACKAGE).as_posix() for file in files}


@pytest.mark.parametrize(("step", "engine"), CASES)
def test_what_a_step_imports_is_in_the_digest_or_decides_nothing(step, engine):
    """A layer that a step begins to import must be entered in the step or, with its reason, above."""
    known = names(provenance.sources(*provenance.modules_of(step, engine)))
    modules = [*MAKERS[step], *([DEFINITIONS[engine].simulation] if engine else [])]
    left = needed_by(*modules) - known
    assert [name for name in sorted(left) if not name.startswith(SILENT)] == []


def test_an_edit_is_another_source_but_line_ends_are_not(tmp_path):
    def digest():
        provenance.source_digest.cache_clear()
        return provenance.source_digest("one.py", "layer/*", folder=tmp_path)

    (tmp_path / "layer" / "inner").mkdir(parents=True)
    digests = [digest()]
    for name in ("one.py", "layer/two.py", "layer/two.css"):
        (tmp_path / name).write_bytes(b"A = 1\n")
        digests.append(digest())
    assert len({*digests}) == 4
    for name, text in (("one.py", b"A = 1\r\n"), ("three.py", b""), ("layer/two.py~", b""), ("layer/inner/x.py", b"")):
        (tmp_path / name).write_bytes(text)
        assert digest() == digests[-1]


def test_another_engine_does_not_make_runs_stale():
    known = names(provenance.sources(*provenance.modules_of("simulate", "langevin")))
    assert {"engines/__init__.py", "scene/seeds.py", "engines/langevin/simulation.py"} <= known
    assert "engines/timestep/simulation.py" not in known
