"""Processes of their own."""

import signal


def hear_interrupts():
    """For `preexec_fn`: what a shell has started in the background ignores interrupts, and so would its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
