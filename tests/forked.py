"""Snakemake, and the commands of its rules, in processes forked from one that has imported what
they take.

The imports take most of the CPU time of a dry run and of a short command. Beyond them a forked
process shares nothing with another one: it has a folder, an environment, a module search path and
arguments of its own, imports brownpipe itself, and begins and ends as `python -m snakemake` or the
program `brownpipe` does. What Python reads only when it starts (PYTHONHASHSEED, TZ, the locale) is
that of the tests; a process in which it is to be another one has to be started by `subprocess`.
"""

import atexit
import gc
import importlib
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

IMPORTED = (
    *(
        "snakemake.cli",
        "snakemake.profiles",
        "snakemake.report.html_reporter",
        "snakemake.storage",
        "smart_open",
    ),
    *("numpy", "pandas", "h5py", "yaml", "requests", "platformdirs", "pygments", "jinja2"),
    *("numba", "scipy.special", "xarray", "matplotlib.figure", "PIL.PngImagePlugin"),
    *("matplotlib.backends.backend_agg", "matplotlib.backends.backend_svg"),
)
LONGEST = 300  # seconds, then a process is ended by SIGALRM
PROGRAM = """\
#!{python} -ISE
import sys
sys.path.append({tests!r})
from forked import run_as
run_as("{name}", {address!r}, sys.argv)
"""


class Done(NamedTuple):
    """The exit status of a process, and what it wrote to standard output and standard error."""

    returncode: int
    printed: str


def ask(address, program, arguments, cwd, env, streams):
    """Have a program run in a forked process and wait for its end; return its exit status.

    `streams` are three file descriptors, which become standard input, output and error of that
    process.
    """
    request = {"program": program, "arguments": arguments, "cwd": cwd, "env": env}
    with socket.socket(socket.AF_UNIX) as server:
        server.connect(address)
        socket.send_fds(server, [b"\0"], streams)
        server.sendall(json.dumps(request).encode("ascii"))
        server.shutdown(socket.SHUT_WR)
        return int(server.makefile().readline())


def run_as(program, address, arguments):
    """Run a program where this process is, with its environment and its streams, and end as the
    program does.
    """
    status = ask(address, program, arguments, os.getcwd(), dict(os.environ), [0, 1, 2])
    raise SystemExit(status if status >= 0 else 128 - status)


def snakemake(*arguments, cwd, env) -> Done:
    """Run `python -m snakemake` with these arguments and wait for its end."""
    with tempfile.TemporaryFile("w+") as output, open(os.devnull) as nothing:
        streams = [nothing.fileno(), output.fileno(), output.fileno()]
        words = ["-m", *map(str, arguments)]
        status = ask(_folder() + "/server", "snakemake", words, str(cwd), dict(env), streams)
        output.seek(0)
        return Done(status, output.read())


@cache
def programs() -> str:
    """Return the folder of the programs `snakemake` and `brownpipe`, which run in forked
    processes.
    """
    folder = Path(_folder(), "bin")
    folder.mkdir()
    known = {
        "python": sys.executable,
        "tests": str(Path(__file__).parent),
        "address": _folder() + "/server",
    }
    for name in ("snakemake", "brownpipe"):
        (folder / name).write_text(PROGRAM.format(name=name, **known))
        (folder / name).chmod(0o755)
    return str(folder)


@cache
def _folder():
    """The folder of the socket of the process that is forked. Both are gone when the tests end."""
    folder = tempfile.TemporaryDirectory()
    outside = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    pipe = subprocess.PIPE
    command = [sys.executable, __file__, folder.name + "/server"]
    server = subprocess.Popen(command, env=outside, stdin=pipe, stdout=pipe, text=True)
    assert server.stdout.readline() == "ready\n"
    atexit.register(folder.cleanup)
    atexit.register(server.communicate)  # closes its standard input and waits
    return folder.name


def _serve(address):
    """Fork for every request. Return in forked processes alone: the name of the program to
    become.
    """
    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()  # forked processes need not search what they inherit for garbage
    gc.set_threshold(50_000)
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C ends forked processes, and the end of the tests this one
    # by the pipe whose other end a process holds until its own end: its number, who asked for it
    running = {}
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(address)
        server.listen()
        print("ready", flush=True)
        while sys.stdin not in (ready := select.select([server, sys.stdin, *running], [], [])[0]):
            for ended in running.keys() & ready:
                child, connection = running.pop(ended)
                os.close(ended)
                _, status = os.waitpid(child, 0)
                with connection, suppress(BrokenPipeError):  # who asked may have been killed
                    connection.sendall(b"%d\n" % os.waitstatus_to_exitcode(status))
            if server in ready:
                connection, _ = server.accept()
                here, there = os.pipe()
                child = os.fork()
                if child == 0:
                    return _become(connection)
                os.close(there)
                running[here] = child, connection
    sys.exit()


def _become(connection):
    """Make a forked process what Python is when it starts a program; return the name of the
    program.
    """
    with connection:
        _, streams, _, _ = socket.recv_fds(connection, 1, 3)
        program, arguments, cwd, env = json.loads(connection.makefile().read()).values()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.alarm(LONGEST)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(env)
    here = [cwd] if arguments[0] == "-m" else []  # a program lies elsewhere
    sys.path[:1] = [*here, *filter(None, env.get("PYTHONPATH", "").split(os.pathsep))]
    sys.argv = arguments
    return program


def _run(program):
    """Run a program from its beginning to its end.

    There what was imported is left as it is: to take it apart would copy all memory shared with the
    server, which takes 0.1 s.
    """
    try:
        runpy.run_module(program, run_name="__main__", alter_sys=sys.argv[0] == "-m")
    except SystemExit as end:
        if not isinstance(end.code, int):
            raise
        threading._shutdown()
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(end.code)


if __name__ == "__main__":
    _run(_serve(sys.argv[1]))
