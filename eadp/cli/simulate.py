"""`eadp simulate`."""


def command() -> int:
    return 0
