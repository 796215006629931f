"""The verbs of the command line, in the order of the help, each with its module.

A verb is a function of the parsed arguments, whose docstring is the help, with an example at its
end, and which returns the exit status (None: done). `add_NAME` beside it is given `add_argument` of
its parser. Imports that take long are inside the functions that need them.
"""

MODULES = {
    "studies": ("new", "run", "check", "plan", "schema"),
    "simulate": ("simulate",),
    "results": ("aggregate", "figures", "tradeoff"),
    "files": ("inspect", "verify", "movie", "export"),
}
VERBS: dict[str, str] = {}
for _module, _verbs in MODULES.items():
    VERBS |= dict.fromkeys(_verbs, _module)
