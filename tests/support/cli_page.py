"""docs/cli.md from the help of the commands: python tests/support/cli_page.py > docs/cli.md"""

import io
import os
import sys
from contextlib import redirect_stdout

HEAD = """\
# The command line

The help of every command, as `eadp COMMAND --help` prints it. `eadp --install-completion` installs the completion of
commands and options in your shell (bash, zsh, fish, PowerShell). Exit codes: 0 yes, 1 no, 2 bad input, 130 interrupted,
70 an internal error. The page is generated: `python tests/support/cli_page.py > docs/cli.md`.
"""


def page() -> str:
    """The text of docs/cli.md."""
    os.environ["COLUMNS"] = "100"  # the help is at most 80 wide
    from eadp.cli.main import COMMANDS, main

    def shown(*arguments: str) -> str:
        out = io.StringIO()
        with redirect_stdout(out):
            main([*arguments, "--help"])
        return f"```text\n{out.getvalue().strip()}\n```\n"

    parts = [HEAD, "## eadp\n", shown()]
    for name in COMMANDS:
        parts += [f"## eadp {name}\n", shown(name)]
    return "\n".join(parts)


if __name__ == "__main__":
    sys.stdout.write(page())
