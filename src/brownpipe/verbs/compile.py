"""`brownpipe compile`: the kernels of a study, before its runs."""

import time
from argparse import Namespace
from collections.abc import Callable

from brownpipe.errors import DONE
from brownpipe.formatting import counted, in_time
from brownpipe.verbs.output import show
from brownpipe.verbs.values import key_value

EXAMPLE = "config/harrison2020.yaml"


def add_arguments(add: Callable) -> None:
    add("study", metavar="STUDY", help="study file (YAML)")
    replaced = "other values of its keys, as for `snakemake --config`"
    add("--config", nargs="+", type=key_value, default=[], metavar="KEY=VALUE", help=replaced)


def compile(arguments: Namespace) -> int:
    """Compile all kernels that the runs of a study need, for the processor of this machine.

    Their machine code is kept on disk, where all later processes find it. Runs compile what they need by themselves;
    on a cluster this verb does it once, before many jobs begin at the same time. What is there is not compiled again.
    """
    from brownpipe import progress
    from brownpipe.engines.compiled import is_compiled, seconds_to_compile
    from brownpipe.engines.compiling import compile_all
    from brownpipe.study import from_command_line, read_study

    study = read_study(arguments.study, from_command_line(dict(arguments.config)))
    runs = [(use.engine, case) for use in study.engine_uses for case in study.cases_of(use) if case.particles]
    calls = [call for engine, case in runs for call in engine.kernel_calls(case) if not is_compiled(call)]
    count, began = len(seconds_to_compile(calls)), time.process_time()
    with progress.shown("compile"):
        compile_all(calls)
    spent = in_time(time.process_time() - began)
    show(f"{counted(count, 'kernel')} compiled in {spent} of CPU" if count else "all kernels have been compiled before")
    return DONE
