"""Computations as decided, for who runs them: a command that is run with new values, or a file that holds the last."""

from __future__ import annotations

import contextlib
import shlex
import subprocess
import time
from collections.abc import Callable, Mapping
from typing import Any

from eadp.api.replan.decisions import json_line
from eadp.errors import InputError, printable
from eadp.io.telemetry.log import ReplanLog
from eadp.io.text.streams import output_file, write_text
from eadp.models.plan.stage import Parameter

LIMIT_S = 10.0
"""Time after which a command is ended [s]: in it a parameter should be in force."""

STDERR = 2


class Hook:
    """Runs a command with computations as they are decided, one at a time and only where they change.

    It never waits for the command. The values follow the command as arguments, as in `fps=7`.

    Parameters
    ----------
    command : str
        The command and its first arguments, as a shell splits them; no shell runs.
    parameters : sequence of Parameter
        The computations.
    log : ReplanLog or None
        Takes the exit code and the time of each run.
    warn : function
        Called with a text where a run fails.

    Raises
    ------
    InputError
        If the command is none.
    """

    def __init__(
        self, command: str, parameters: tuple[Parameter, ...], log: ReplanLog | None, warn: Callable[[str], None]
    ) -> None:
        try:
            self._command = shlex.split(command)
        except ValueError:
            self._command = []
        if not self._command:
            raise InputError.at("--apply", 1, 1, "is no command", "a program and its arguments", command)
        self._parameters, self._log, self._warn = parameters, log, warn
        self._process: subprocess.Popen[bytes] | None = None
        self._started_s = 0.0
        # as of `_values`: the values last decided, and those of the last run, empty where that run failed
        self._wanted: dict[str, Any] = {}
        self._run: dict[str, Any] = {}

    def decided(self, decision: Mapping[str, Any]) -> None:
        """Take a decision: start the command if values have changed, unless a run goes on."""
        self._wanted = _values(decision, self._parameters)
        self._poll()
        self._start()

    def close(self) -> None:
        """Wait for the run that goes on, and for one more run where other values were decided meanwhile."""
        for _ in range(2):
            if self._process is not None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(max(0.0, self._started_s + LIMIT_S - time.monotonic()))
                failed = self._poll(last=True)
                if not failed:
                    self._start()

    def _start(self) -> None:
        """Start the command with the values last decided, unless a run goes on, or the last run had these values."""
        if self._process is not None or self._wanted.get("parameters") == self._run.get("parameters"):
            return
        self._run, self._started_s = self._wanted, time.monotonic()
        arguments = [f"{name}={value:.10g}" for name, value in self._run["parameters"].items()]
        try:  # what it prints is not mixed with decisions
            self._process = subprocess.Popen([*self._command, *arguments], stdin=subprocess.DEVNULL, stdout=STDERR)
        except (OSError, ValueError) as error:
            self._ended(None, getattr(error, "strerror", None) or str(error))

    def _poll(self, *, last: bool = False) -> bool:
        """See whether the run has ended, and end it after `LIMIT_S`, or at once if `last`; return whether it failed."""
        process = self._process
        code = None if process is None else process.poll()
        if process is None or (code is None and not last and time.monotonic() - self._started_s <= LIMIT_S):
            return False
        if code is None:
            process.kill()
            process.wait()
        self._process = None
        self._ended(code, f"took more than {LIMIT_S:g} s" if code is None else f"exit code {code}")
        return code != 0

    def _ended(self, code: int | None, what: str) -> None:
        """Log the end of a run by its exit code, None without one; warn if it failed, for the reason `what`."""
        run = self._run  # the time of the decision [s], and its values
        if self._log is not None:
            self._log.applied({**run, "exit_code": code, "took_s": round(time.monotonic() - self._started_s, 3)})
        if code != 0:
            values = ", ".join(f"{name} {value:g}" for name, value in run["parameters"].items())
            self._run = {}  # tried again with the next decision
            self._warn(f"{printable(self._command[0])} did not apply {values}: {printable(what)}")


class ValuesFile:
    """A file that holds computations as last decided: one line of JSON, replaced whole where they change.

    Parameters
    ----------
    path : str
    parameters : sequence of Parameter
        The computations.
    warn : function
        Called with a text where the file cannot be written.

    Raises
    ------
    InputError
        If the path is no regular file's.
    """

    def __init__(self, path: str, parameters: tuple[Parameter, ...], warn: Callable[[str], None]) -> None:
        output_file(path)
        self._path, self._parameters, self._warn = path, parameters, warn
        self._written: dict[str, Any] = {}
        self._failed = ""

    def decided(self, decision: Mapping[str, Any]) -> None:
        """Take a decision: write the file if values have changed."""
        values = _values(decision, self._parameters)
        if values["parameters"] == self._written.get("parameters"):
            return
        try:
            write_text(self._path, json_line(values))
            self._written, self._failed = values, ""
        except InputError as error:  # tried again with the next decision
            if self._failed != str(error):
                self._failed = str(error)
                self._warn(error.faults[0].message)


def _values(decision: Mapping[str, Any], parameters: tuple[Parameter, ...]) -> dict[str, Any]:
    """The time of a decision [s], and its computations as people read them."""
    shown = {each.label: each.shown(decision["parameters"][each.name]) for each in parameters}
    return {"time_s": decision["time_s"], "parameters": shown}
