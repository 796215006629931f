"""Ask the server of `forked.py` for a process. A program that does no more starts in 0.02 s: it imports little."""

import json
import os
import socket


def ask(address, program, arguments, cwd, env, streams):
    """Have a program run in a forked process and wait for its end; return its exit status.

    `streams` are three file descriptors, which become standard input, output and error of that process.
    """
    request = {"program": program, "arguments": arguments, "cwd": cwd, "env": env}
    with socket.socket(socket.AF_UNIX) as server:
        server.connect(address)
        socket.send_fds(server, [b"\0"], streams)
        server.sendall(json.dumps(request).encode("ascii"))
        server.shutdown(socket.SHUT_WR)
        return int(server.makefile().readline())


def run_as(program, address, arguments):
    """Run a program where this process is, with its environment and its streams, and end as the program does."""
    status = ask(address, program, arguments, os.getcwd(), dict(os.environ), [0, 1, 2])
    raise SystemExit(status if status >= 0 else 128 - status)
