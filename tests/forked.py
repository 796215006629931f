"""Snakemake in processes forked from one that has imported it.

The imports take most of the CPU time of a dry run. Beyond them a forked process shares nothing with another one: it has
a folder, an environment, a module search path and arguments of its own, imports brownpipe itself, and begins and ends
as `python -m snakemake` does. What Python reads only when it starts (PYTHONHASHSEED, TZ, the locale) is that of the
tests; a process in which it is to be another one has to be started by `subprocess`.
"""

import atexit
import gc
import importlib
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
from functools import cache
from typing import NamedTuple

IMPORTED = (
    *("snakemake.cli", "snakemake.profiles", "snakemake.report.html_reporter", "snakemake.storage", "smart_open"),
    *("numpy", "pandas", "h5py", "yaml", "requests", "platformdirs", "pygments", "jinja2"),
)
LONGEST = 300  # seconds, then a process is ended by SIGALRM


class Done(NamedTuple):
    """The exit status of a process, and what it wrote to standard output and standard error."""

    returncode: int
    printed: str


def snakemake(*arguments, cwd, env) -> Done:
    """Run `python -m snakemake` with these arguments and wait for its end."""
    server = _server()
    with tempfile.NamedTemporaryFile("r") as output:
        request = {"arguments": [*map(str, arguments)], "cwd": str(cwd), "env": dict(env), "output": output.name}
        server.stdin.write(json.dumps(request) + "\n")
        server.stdin.flush()
        return Done(int(server.stdout.readline()), output.read())


@cache
def _server():
    """The process that is forked. It ends with the tests."""
    outside = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    pipe = subprocess.PIPE
    server = subprocess.Popen([sys.executable, __file__], env=outside, stdin=pipe, stdout=pipe, text=True)
    atexit.register(server.communicate)  # closes its standard input and waits
    return server


def _serve():
    """Fork for every request, a line of JSON, and answer with the exit status. Return in forked processes alone."""
    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()  # forked processes need not search what they inherit for garbage
    gc.set_threshold(50_000)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends forked processes, and the end of the tests this one
    while line := sys.stdin.readline():
        child = os.fork()
        if child == 0:
            _become(**json.loads(line))
            return
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)
    sys.exit()


def _become(arguments, cwd, env, output):
    """Make a forked process what `python -m snakemake` is when it starts, in a folder and with an environment."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.alarm(LONGEST)
    atexit.register(gc.freeze)
    for stream, path in enumerate([os.devnull, output, output]):
        file = os.open(path, os.O_RDWR | os.O_APPEND)
        os.dup2(file, stream)
        os.close(file)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(env)
    sys.path[:1] = [cwd, *filter(None, env.get("PYTHONPATH", "").split(os.pathsep))]
    sys.argv[1:] = arguments


if __name__ == "__main__":
    _serve()
    runpy.run_module("snakemake", run_name="__main__", alter_sys=True)
