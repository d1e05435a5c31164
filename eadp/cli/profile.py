"""`eadp profile`."""


def command() -> int:
    return 0
