"""Command lines: what they answered, and processes of their own; faults of a text as they are printed."""

import signal

import pytest

from eadp.errors import InputError


def refused(answer, *words):
    """One clear error, exit 2, nothing on stdout."""
    assert answer.code == 2
    assert answer.out == ""
    assert "Traceback" not in answer.err
    for word in words:
        assert word in answer.err
    return True


def first_lines(faults, name=""):
    """LINE:COL: and what faults say, without their quoted lines and the name of their file."""
    return [str(fault).splitlines()[0].removeprefix(f"{name}:" if name else "") for fault in faults]


def faults_by(read, *given, name="", **options):
    """The first lines of all the faults with which something is not read."""
    with pytest.raises(InputError) as caught:
        read(*given, **options)
    return first_lines(caught.value.faults, name)


def hear_interrupts():
    """For `preexec_fn`: what a shell has started in the background ignores interrupts, and so would its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
