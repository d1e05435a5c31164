"""`eadp schema`."""


def command() -> int:
    return 0
