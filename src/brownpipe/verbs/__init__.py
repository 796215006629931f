"""The verbs of the command line, in the order of the help.

A verb is a function of the parsed arguments, whose docstring is the help, with an example at its end, and which returns
the exit status (None: done). `add_NAME` beside it is given `add_argument` of its parser. Imports that take long are
inside the functions that need them.
"""

from brownpipe.verbs import files, results, simulate, studies

OF_STUDIES, OF_RUNS = (studies.new, studies.run), (simulate.simulate, results.aggregate, results.figures)
OTHERS = (files.movie, files.export, results.tradeoff, studies.plan, files.inspect, files.verify, studies.check)
VERBS = {verb.__name__: verb for verb in (*OF_STUDIES, *OF_RUNS, *OTHERS, studies.schema)}
