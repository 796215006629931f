"""The verbs of the command line, one module each, in the order of the help.

A module has the function of its name, whose docstring is the help and which returns the exit status (None: done);
`add_arguments`, which is given `add_argument` of the verb's parser; and EXAMPLE, the arguments of an example. If it has
PASSES_ON, arguments after `--` are for another program. Imports that take time are inside the functions that need them.
"""

from importlib import import_module

NAMES = "new run simulate aggregate figures movie export tradeoff plan inspect verify check schema"
VERBS = {name: import_module(f"{__name__}.{name}") for name in NAMES.split()}
