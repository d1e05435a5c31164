"""Console blocks of a page: their commands are run, and what they show is compared with what they print."""

import io
import re
import shlex
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from common import ROOT
from eadp.cli.main import main

BLOCK = re.compile(r"```console\n(?P<body>.*?)```", re.DOTALL)
COMMAND = re.compile(r"^\$ (?P<command>(?:[^\n]*\\\n)*[^\n]*)\n", re.MULTILINE)
FILE = re.compile(r"```yaml\n# (?P<name>\S+)\n(?P<body>.*?)```", re.DOTALL)
EXIT_CODE = "echo $?"
FOLDERS = ("plans", "profiles", "scenarios", "vehicles", "tests")
"""What the pages' commands read, relative to the repository."""


@dataclass
class Console:
    """Runs commands of a page in a folder of their own that shows the repository's inputs."""

    folder: Path
    code: int = 0

    def __post_init__(self) -> None:
        for name in FOLDERS:
            (self.folder / name).symlink_to(ROOT / name)

    def write_files(self, text: str) -> None:
        """Write the page's YAML blocks whose first line is a comment with a file's name."""
        for match in FILE.finditer(text):
            path = self.folder / match["name"]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(match["body"], encoding="utf-8")

    def run(self, command: str) -> str:
        """What a command prints: its standard output, and its errors if the input is bad."""
        if command == EXIT_CODE:
            return f"{self.code}\n"
        out, err = io.StringIO(), io.StringIO()
        name, *arguments = shlex.split(command.replace("\\\n", " "))
        assert name == "eadp", command
        with redirect_stdout(out), redirect_stderr(err):
            self.code = main(arguments)
        return out.getvalue() + (err.getvalue() if self.code == 2 else "")

    def fresh(self, block: str) -> str:
        """The block with the present output of its commands."""
        return "".join(f"$ {command}\n{self.run(command)}" for command in COMMAND.findall(block))


def blocks(page: Path) -> list[str]:
    """The bodies of a page's console blocks."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def commands(block: str) -> list[list[str]]:
    """The words of a block's commands."""
    return [shlex.split(command.replace("\\\n", " ")) for command in COMMAND.findall(block)]


def missing_links(page: Path) -> list[str]:
    """The targets of a page's links that do not exist."""
    links = re.findall(
        r"\]\(([^)#\s]+)[^)]*\)", re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    )
    assert links
    return [link for link in links if not link.startswith("http") and not (page.parent / link).exists()]


def update(page: Path, console: Console) -> None:
    """Write the present output of every block into the page."""
    text = page.read_text(encoding="utf-8")
    console.write_files(text)
    page.write_text(BLOCK.sub(lambda block: f"```console\n{console.fresh(block['body'])}```", text), encoding="utf-8")
