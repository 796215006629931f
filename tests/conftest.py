"""What all tests need: Ctrl-C works, also where they are started in the background of a shell, which ignores it."""

import signal

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # the processes that tests start inherit the default
