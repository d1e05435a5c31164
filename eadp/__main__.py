"""The process of the command `eadp`: signals and standard streams are in order before anything slow is imported."""

import contextlib
import gc
import os
import signal
import sys
from typing import Any, NoReturn

INTERRUPTED = 130
_SIGNALS = (signal.SIGINT, signal.SIGTERM)

COLLECTED_AFTER = 400_000
"""New objects after which Python looks for cycles: its 700 cost a tenth of the time in which libraries are imported."""


def run() -> NoReturn:
    """Run the command line of this process and exit with its code."""
    _handle_signals(_leave)
    _replace_closed_streams()
    gc.set_threshold(COLLECTED_AFTER)
    from eadp.cli.main import main

    _handle_signals(_interrupt)
    code = main(sys.argv[1:])
    _handle_signals(signal.SIG_IGN)  # the result stands
    gc.freeze()  # the memory goes with the process: Python would look through all of it
    if code == INTERRUPTED:  # Python would end itself by the signal where one has gone through `exec`
        os._exit(code)
    sys.exit(code)


def _handle_signals(handler: Any) -> None:
    for number in _SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as in a shell's background
            signal.signal(number, handler)


def _leave(_number: int, _frame: Any) -> NoReturn:
    """End at once: an exception in an import may be swallowed or become another one, and nothing is written yet."""
    with contextlib.suppress(OSError):
        os.write(2, b"eadp: interrupted\n")
    os._exit(INTERRUPTED)


def _interrupt(_number: int, _frame: Any) -> NoReturn:
    """SIGTERM ends a command as Ctrl-C does, so that half-written files are removed."""
    raise KeyboardInterrupt


def _replace_closed_streams() -> None:
    """Put a stream that cannot be used in the place of a closed one, so that no file gets its number."""
    for number, (name, flags, mode) in enumerate(
        (("stdin", os.O_WRONLY, "r"), ("stdout", os.O_RDONLY, "w"), ("stderr", os.O_WRONLY, "w"))
    ):
        if getattr(sys, name) is None:
            os.open(os.devnull, flags)  # the lowest number that is free, which is this one
            setattr(sys, name, open(number, mode, encoding="utf-8"))  # noqa: SIM115 - open to the end of the process


if __name__ == "__main__":
    run()
