"""Errors with many faults."""

from __future__ import annotations

import pytest

from eadp.errors import FAULTS_SHOWN, Fault, InputError, refuse


def test_faults_beyond_the_first_are_counted():
    faults = [Fault("f", line, 1, f"fault {line}", source="x") for line in range(1000, 0, -1)]
    with pytest.raises(InputError) as caught:
        refuse(faults)
    assert [fault.line for fault in caught.value.faults] == [*range(1, FAULTS_SHOWN + 2)]
    assert (
        str(caught.value).splitlines()[-1]
        == f"f:{FAULTS_SHOWN + 1}:1: error: {1000 - FAULTS_SHOWN} more faults from here on"
    )
    refuse([])
