"""The command line: the parser of its verbs, and the exit status and the one line on stderr for an error.

Only `verbs` and `progress` write to the screen otherwise, with one exception: `scene.reading.current_name` says on
stderr that a name has been replaced by a newer one.
"""

import argparse
import atexit
import difflib
import errno
import gc
import os
import re
import signal
import sys
from argparse import Namespace
from collections.abc import Sequence
from typing import NoReturn

from brownpipe import interrupts
from brownpipe.completion import bash_script
from brownpipe.errors import (
    FAILED,
    LEAST_MEMORY,
    WRONG_REQUEST,
    BrownpipeError,
    has_limited_memory,
    has_too_little_memory,
    leave_time_for_a_last_line,
    limits,
    ran_out_of_memory,
)
from brownpipe.quoting import printable
from brownpipe.verbs import VERBS
from brownpipe.verbs.output import say

JOINED = "several values of an option are joined by commas"
GARBAGE = 500_000  # new objects after which Python searches for garbage: more than most verbs make


def main(argv: list[str] | None = None) -> int:
    """Run one verb; return the exit status.

    Without `argv` the process is that of the command: it ends then, and Python searches its memory for garbage less
    often, and not at all when it ends, which saves 0.3 s of CPU.
    """
    _replace_closed_streams()
    if has_limited_memory():
        sys.unraisablehook = _complain
    if argv is None:
        # No verb gains from threads of OpenBLAS; without memory for them it sends SIGINT to its own process.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        gc.set_threshold(GARBAGE)
        atexit.register(gc.freeze)
    with interrupts.ending_process():
        status = _status(sys.argv[1:] if argv is None else argv)
        if argv is None:
            signal.signal(signal.SIGXCPU, signal.SIG_IGN)  # all is done; at its end Python restores the default: to die
            interrupts.leave(status)
    return status


def _status(argv: list[str]) -> int:
    """Run one verb; return the exit status, after one line on stderr for an error."""
    if has_too_little_memory():
        return say(f"out of memory{limits()}; must be at least {LEAST_MEMORY // 2**20} MB", FAILED)
    try:
        signal.signal(signal.SIGXCPU, _stop_at_limit)
        leave_time_for_a_last_line()
        sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # print any path in any encoding
        own, further = _divide(argv)
        arguments = build_parser(own).parse_args(own, Namespace(argv=argv, further=further))
        status = arguments.verb(arguments)
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        return say("interrupted", 128 + signal.SIGINT)
    except interrupts.Terminated:
        return say("terminated", 128 + signal.SIGTERM)
    except Exception as error:
        number = None if isinstance(error, BrownpipeError) else interrupts.arrived()
        if number:  # its exception became this one, as in the import of NumPy
            return say(interrupts.SIGNALS[signal.Signals(number)], 128 + number)
        return _status_after(error)
    finally:
        _finish_printing()


def _status_after(error: Exception) -> int:
    """Say in one line what went wrong, and return the exit status; an error of the program itself is raised again."""
    if isinstance(error, BrokenPipeError):  # the reader is gone
        return FAILED
    if isinstance(error, BrownpipeError):
        return say(str(error), error.exit_status)
    if ran_out_of_memory(error):
        return say(f"out of memory{limits()}", FAILED)
    if isinstance(error, OSError) and error.errno == errno.EMFILE:
        return say(f"too many open files; must be a higher limit (ulimit -n): {error.filename}", FAILED)
    if isinstance(error, OSError):
        return say(str(error), FAILED)
    raise error


def _replace_closed_streams() -> None:
    """Open the null device in place of closed standard streams, whose numbers the next opened files would get."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), "w" if number else "r"))


def _finish_printing() -> None:
    """Flush standard output; without a reader drop what is left, or Python would report an error at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _complain(found: "sys.UnraisableHookArgs") -> None:
    """Show an error that nothing can handle, but no lack of memory, which ends the program a moment later."""
    if not ran_out_of_memory(found.exc_value):
        sys.__unraisablehook__(found)


def _stop_at_limit(*_: object) -> NoReturn:
    sys.unraisablehook = lambda _: None  # no errors of what is left unfinished
    sys.exit(say(f"CPU time ran out{limits()}", 128 + signal.SIGXCPU))


def _divide(argv: list[str]) -> tuple[list[str], list[str]]:
    """Return the arguments of brownpipe and those after `--`, if the verb passes them on to another program."""
    passes_on = argv and getattr(VERBS.get(argv[0]), "PASSES_ON", False)
    end = argv.index("--") if passes_on and "--" in argv else len(argv)
    return argv[:end], argv[end + 1 :]


def build_parser(argv: Sequence[str]) -> "_Parser":
    """Return the parser of a command line.

    Only the verb that `argv` begins with gets its arguments: those of `simulate` take time, as they import all engines.
    """
    parser = _Parser("brownpipe", description="Exact dynamics of hard disks, with a heavy one among light ones.")
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    parser.add_argument("--completion", action=_Completion, nargs=0, help="print the completion script for bash")
    subparsers = parser.add_subparsers(metavar="VERB", required=True)
    for name, module in VERBS.items():
        verb = getattr(module, name)
        brief, epilog = verb.__doc__.partition("\n")[0], f"example: brownpipe {name} {module.EXAMPLE}"
        subparser = subparsers.add_parser(name, help=brief, description=verb.__doc__, epilog=epilog)
        subparser.set_defaults(verb=verb)
        if name in argv[:1]:
            parser.of_verb = subparser
            module.add_arguments(subparser.add_argument)
    return parser


class _Parser(argparse.ArgumentParser):
    """An argparse parser whose error messages are one line, with a hint for common mistakes."""

    of_verb: argparse.ArgumentParser | None = None  # of the verb that is given

    def error(self, message: str) -> NoReturn:
        parser = self.of_verb or self
        hinted = _with_hint(" ".join(message.split()), [name for one in parser._actions for name in one.option_strings])
        self.exit(WRONG_REQUEST, f"{printable(f'{parser.prog}: {hinted} (see {parser.prog} --help)')}\n")


def _with_hint(message: str, options: Sequence[str]) -> str:
    """Return a message of argparse with what was probably meant; `options` are those of the verb."""
    if found := re.fullmatch(r"unrecognized arguments: (\S+).*", message):
        near = difflib.get_close_matches(found[1], options, n=1) if found[1].startswith("-") else []
        is_file = "." in found[1] or found[1].startswith("-")
        return message + (f"; did you mean {near[0]}?" if near else "" if is_file else f"; {JOINED}")
    if re.search(r"\.(h5|nc|ya?ml)'", message) and "argument --" in message:
        return re.sub(r"(\.(?:h5|nc|ya?ml)')", r"\1; files are given before the options", message)
    if found := re.search(r"(invalid choice: '([^']+)') \(choose from (.*)\)", message):
        near = difflib.get_close_matches(found[2].lower(), re.findall(r"\w+", found[3]), n=1)
        hint = "several are separated by blanks" if "," in found[2] else f"did you mean {near[0]}?" if near else ""
        return message.replace(found[1], f"{found[1]}; {hint}") if hint else message
    return message


class _Completion(argparse.Action):
    """Print the script; only now are the arguments of all verbs made."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        parsers = {name: build_parser([name]).of_verb for name in VERBS}
        print(bash_script(parsers), end="")
        parser.exit()


class _Version(argparse.Action):
    """Look up the version only if it is to be shown."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from importlib.metadata import version

        print("brownpipe", version("brownpipe"))
        parser.exit()
