"""The verbs of the command line, one module each.

A module has the function of its name, whose docstring is the help and which returns the exit status; `add_arguments`;
and EXAMPLE, the arguments of an example. If it has PASSES_ON, arguments after `--` are for another program. Imports
that take time are inside the functions that need them.
"""

from brownpipe.verbs import (
    aggregate,
    check,
    compile,
    export,
    figures,
    inspect,
    movie,
    new,
    plan,
    run,
    schema,
    simulate,
    tradeoff,
    verify,
)

VERBS = {  # as in the help
    module.__name__.rpartition(".")[2]: module
    for module in (
        new,
        run,
        simulate,
        aggregate,
        figures,
        movie,
        export,
        tradeoff,
        plan,
        inspect,
        verify,
        check,
        compile,
        schema,
    )
}
