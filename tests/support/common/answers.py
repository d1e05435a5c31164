"""What a command line answered."""


def refused(answer, *words):
    """One clear error, exit 2, nothing on stdout."""
    assert answer.code == 2
    assert answer.out == ""
    assert "Traceback" not in answer.err
    for word in words:
        assert word in answer.err
    return True
