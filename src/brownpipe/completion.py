"""Completion of the command line in bash: a script without Python, so that a key press takes no time."""

import argparse
from collections.abc import Mapping

SCRIPT = """\
# bash completion of brownpipe, printed by: brownpipe --completion
_brownpipe() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}} words=
    case $COMP_CWORD:${{COMP_WORDS[1]}}:$before in
        1:*) words="{verbs}" ;;
{values}
        *) case ${{COMP_WORDS[1]}}:$word in
{options}
        esac ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _brownpipe brownpipe
"""


def bash_script(parsers: Mapping[str, argparse.ArgumentParser]) -> str:
    """Return the script that completes verbs, the options of each verb, their words, and file names elsewhere.

    The words of an option are its `choices`, or its attribute `words`, which argparse does not check.
    """
    values, options = [], []
    for verb, parser in parsers.items():
        actions = [action for action in parser._actions if action.help != argparse.SUPPRESS]
        names = " ".join(action.option_strings[-1] for action in actions if action.option_strings)
        options.append(f'            {verb}:-*) words="{names}" ;;')
        for action in actions:
            words = action.choices or getattr(action, "words", ())
            before = action.option_strings[-1] if action.option_strings else verb
            values += [f'        *:{verb}:{before}) words="{" ".join(words)}" ;;'] if words else []
    return SCRIPT.format(verbs=" ".join(parsers), values="\n".join(values), options="\n".join(options))
