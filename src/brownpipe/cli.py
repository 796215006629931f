"""The command line: the parser of its verbs, and the exit status and the one line on stderr for an
error.

Only `verbs` and `progress` write to the screen otherwise.
"""

import argparse
import gc
import os
import re
import signal
import sys
from argparse import Namespace
from collections.abc import Sequence
from typing import NoReturn

from brownpipe import processes
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, BrownpipeError
from brownpipe.provenance import versions
from brownpipe.text import printable
from brownpipe.verbs import VERBS, Verb, load_verb
from brownpipe.verbs.screen import say

# new objects between two garbage collections: many, to save CPU time of figures and analysis
GARBAGE = 500_000
JOINED = "several values of an option are joined by commas"


def main(argv: list[str] | None = None) -> int:
    """Run one verb; return the exit status. Without `argv` the process serves this command
    alone.
    """
    if argv is not None:
        with processes.handled({signal.SIGTERM: processes.terminate}):
            return _status(argv)
    signal.signal(signal.SIGTERM, processes.terminate)
    sys.unraisablehook = processes.send_again
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # print any path in any encoding
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # no verb gains from more
    os.environ["MPLBACKEND"] = "agg"  # that of a notebook's shell may not be installed here
    gc.set_threshold(GARBAGE)
    status = _status(sys.argv[1:])
    for number in processes.SIGNALS:  # ignored from now on: the work is done
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # no collection at exit
    return status


def _status(argv: list[str]) -> int:
    """Run one verb; return the exit status, after one line on stderr for an error."""
    try:
        try:
            parser = build_parser(argv)
            arguments, further = parser.parse_known_args(argv, Namespace(argv=argv))
            # passed on to another program
            arguments.further = [word for word in further if word != "--"]
            if further and argv[0] != "run":
                parser.error(f"unrecognized arguments: {' '.join(further)}")
            verb: Verb = arguments.verb
            return verb.run(arguments) or DONE
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        return say("interrupted", 128 + signal.SIGINT)
    except processes.Terminated:
        return say("terminated", 128 + signal.SIGTERM)
    except BrokenPipeError:  # nobody reads on; Python would report it once more when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except BrownpipeError as error:
        return say(str(error), error.exit_status)
    except MemoryError:
        return say("out of memory", FAILED)
    except OSError as error:
        return say(str(error), FAILED)


def build_parser(argv: Sequence[str]) -> "_Parser":
    """Return the parser of a command line.

    If `argv` begins with a verb, only its module is imported: importing all takes time.
    """
    parser = _Parser(
        "brownpipe", description="Exact dynamics of hard disks, with a heavy one among light ones."
    )
    version = ""
    if "--version" in argv:  # to look it up takes time
        version = f"brownpipe {versions()['brownpipe_version']}"
    parser.add_argument(
        "--version", action="version", version=version, help="show the version and exit"
    )
    subparsers = parser.add_subparsers(metavar="VERB", required=True)
    requested = [name for name in argv[:1] if name in VERBS]
    for name in requested or VERBS:
        verb = load_verb(name)
        description, _, example = (verb.run.__doc__ or "").rpartition("\n\n")
        first_sentence = " ".join(description.split()).partition(". ")[0]
        brief = first_sentence.removesuffix(".") + "."
        subparser = subparsers.add_parser(
            name, help=brief, description=description, epilog=example.strip()
        )
        subparser.set_defaults(verb=verb)
        if requested:
            parser.verb_parser = subparser
            verb.add_options(subparser.add_argument)
    return parser


class _Parser(argparse.ArgumentParser):
    """An argparse parser whose error messages are one line, with a hint for common mistakes."""

    verb_parser: argparse.ArgumentParser | None = None  # that of the given verb

    def error(self, message: str) -> NoReturn:
        parser = self.verb_parser or self
        options: list[str] = []
        for action in parser._actions:
            options += action.option_strings
        hinted = _with_hint(" ".join(message.split()), options)
        line = f"{parser.prog}: {hinted} (see {parser.prog} --help)"
        self.exit(WRONG_REQUEST, f"{printable(line)}\n")


def _with_hint(message: str, options: Sequence[str]) -> str:
    """Return a message of argparse with what was probably meant; `options` are those of the
    verb.
    """
    from brownpipe.scene.reading import did_you_mean  # takes 0.2 s

    unrecognized = re.fullmatch(r"unrecognized arguments: (\S+).*", message)
    if unrecognized:
        word = unrecognized[1]
        hint = did_you_mean(word, options) if word.startswith("-") else JOINED
        return f"{message}; {hint}".rstrip("; ")
    invalid = re.search(r"(invalid choice: '([^']+)') \(choose from (.*)\)", message)
    if invalid:
        reason, word, choices = invalid.groups()
        hint = did_you_mean(word, re.findall(r"\w+", choices))
        return message.replace(reason, f"{reason}; {hint}".rstrip("; "))
    return message
