"""`eadp plan`."""


def command() -> int:
    return 0
