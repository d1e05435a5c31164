"""Rewrite the errors that tests/bad/*.plan must give: python tests/regenerate.py, then see what git says.

Run from anywhere. A plan that can be read after all is named, and keeps its old file.
"""

import os
import sys
from pathlib import Path

from eadp.errors import InputError
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text

ROOT = Path(__file__).resolve().parent.parent
BAD = Path("tests", "bad")


def main() -> int:
    """Write tests/bad/NAME.expected for every tests/bad/NAME.plan; return the exit code."""
    os.chdir(ROOT)
    readable = []
    for path in sorted(BAD.glob("*.plan")):
        try:
            read_plan(read_text(path.as_posix()))
        except InputError as error:
            path.with_suffix(".expected").write_text(f"{error}\n", encoding="utf-8")
        else:
            readable.append(path.as_posix())
    for name in readable:
        print(f"{name} can be read")
    return 1 if readable else 0


if __name__ == "__main__":
    sys.exit(main())
