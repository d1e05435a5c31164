"""Print the README's two set-up command lines, their virtual environment and results moved to a given folder."""

import re
import sys
from pathlib import Path


def lines(readme: str) -> list[str]:
    """The commands of the blocks marked `main job` and `tests`, one line each."""
    found = re.findall(r"<!-- (?:main job|tests) -->\n```sh\n(.+?)\n```", readme, re.DOTALL)
    if len(found) != 2:
        sys.exit("README.md: expected one block marked 'main job' and one marked 'tests'")
    return [re.sub(r"\s*\\\n\s*", " ", block).replace("\n", " && ") for block in found]


def moved(line: str, folder: str) -> str:
    """The command with .venv and runs/ in another folder."""
    return line.replace(".venv", f"{folder}/venv").replace("runs/", f"{folder}/runs/")


if __name__ == "__main__":
    text = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
    sys.stdout.write("".join(f"{moved(line, sys.argv[1])}\n" for line in lines(text)))
