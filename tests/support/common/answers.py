"""Command lines: what they answered, and processes of their own."""

import signal


def refused(answer, *words):
    """One clear error, exit 2, nothing on stdout."""
    assert answer.code == 2
    assert answer.out == ""
    assert "Traceback" not in answer.err
    for word in words:
        assert word in answer.err
    return True


def hear_interrupts():
    """For `preexec_fn`: what a shell has started in the background ignores interrupts, and so would its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
