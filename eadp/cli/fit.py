"""`eadp fit`."""


def command() -> int:
    return 0
