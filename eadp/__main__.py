"""`python -m eadp` is the command `eadp`."""

from eadp.cli.main import run

if __name__ == "__main__":
    run()
