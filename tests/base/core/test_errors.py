"""Faults beyond those that are shown: counted under the gravest severity among them, and again the same."""

import pickle

import pytest

from eadp.errors import FAULTS_SHOWN, Fault, InputError, first_faults


@pytest.mark.parametrize(
    ("hidden", "said"),
    [
        ("error warning", "error: 2 more faults from here on"),
        ("warning error note", "error: 3 more faults from here on"),
        ("note warning", "warning: 2 more warnings and notes from here on"),
        ("warning warning", "warning: 2 more warnings from here on"),
        ("note note", "note: 2 more notes from here on"),
    ],
)
def test_the_rest_is_counted_under_its_gravest_severity(hidden, said):
    severities = ["warning"] * FAULTS_SHOWN + hidden.split()
    faults = [Fault("a", line, 1, "wrong", severity=each) for line, each in enumerate(severities, 1)]
    assert str(first_faults(faults)[-1]) == f"a:{FAULTS_SHOWN + 1}:1: {said}"


@pytest.mark.parametrize("count", [1, FAULTS_SHOWN, FAULTS_SHOWN + 1, FAULTS_SHOWN + 30])
def test_an_error_from_another_process_says_the_same(count):
    error = InputError(*(Fault("a", line, 1, "wrong") for line in range(1, count + 1)))
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
