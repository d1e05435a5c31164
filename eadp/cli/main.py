"""The command `eadp`: its commands, and the one place where errors become exit codes."""

from __future__ import annotations

import functools
import io
import os
import sys
import traceback
from collections.abc import Callable
from typing import Annotated, Any

import typer
import typer.core

from eadp import __version__
from eadp.cli.output import escaped, faults_text, grouped
from eadp.errors import EadpError, InputError, printable
from eadp.plug_ins import added_names, plug_in

YES, NO, BAD_INPUT, BUG, INTERRUPTED = 0, 1, 2, 70, 130

GROUPS = {
    "Your aircraft": ("init", "vehicle", "fit", "profile"),
    "A plan": ("cover", "plan", "export"),
    "Its flight": ("simulate", "sweep", "replan", "report"),
}
"""Commands by group in the help; those of no group come last."""


class _Grouped(typer.core.TyperGroup):
    """The command group, whose help lists its commands in groups."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the groups and their commands."""
        rest = [name for name in COMMANDS if not any(name in group for group in GROUPS.values())]
        for title, names in (*GROUPS.items(), ("More", [*rest, *added_names("commands")])):
            with formatter.section(title):
                formatter.write_dl([(name, COMMANDS.get(name, ADDED)) for name in names])


SECTIONS = "Field", "Camera", "Aircraft", "Take-off, landing and wind", "Lines and turns", "Ground", "Sorties"
"""Sections of a command's options in its help, the commonest first; options of no section come last."""


class _Sectioned(typer.core.TyperCommand):
    """A command whose help lists its options in sections."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, and the options by section."""
        found: dict[str, list[tuple[str, str]]] = {name: [] for name in ("Arguments", *SECTIONS, "Options")}
        for each in self.get_params(ctx):
            if (record := each.get_help_record(ctx)) is not None:
                plain = "Arguments" if each.param_type_name == "argument" else "Options"
                found[getattr(each, "rich_help_panel", None) or plain].append(record)
        for title, records in found.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


COMMANDS = {
    "plan": "Parse a plan into its stages.",
    "profile": "Build the computation energy model from measurements.",
    "fit": "Estimate period, order and Fourier coefficients from a power log.",
    "simulate": "Fly a plan in simulation, re-planning on the way.",
    "cover": "Cover a field: from its outline to a plan.",
    "export": "Write a plan as an autopilot's mission, or as a map.",
    "sweep": "Fly many times: a grid or a random sample, resumable.",
    "replan": "Re-plan a live or recorded flight: telemetry in, decisions out.",
    "init": "Start a folder: an aircraft, a scenario, and a plan that flies.",
    "vehicle": "Print what an aircraft can do: speeds, power, endurance, range.",
    "report": "Write a flight or a sweep as one HTML page.",
    "schema": "Print the JSON Schema of a file format.",
}
"""The commands of eadp, and what they do."""

ADDED = "Of an installed package."


class _Closed(Exception):
    """The reader of the output has closed the pipe."""


def _shielded(command: Callable[..., int]) -> Callable[..., int]:
    """A command that distinguishes a closed pipe from an interruption: typer would end the process itself."""

    @functools.wraps(command)
    def shielded(*args: Any, **options: Any) -> int:
        try:
            code = command(*args, **options)
            sys.stdout.flush()
            return code
        except BrokenPipeError:
            raise _Closed from None
        except KeyboardInterrupt:
            raise typer.Abort from None  # Ctrl-C, or SIGTERM

    return shielded


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"eadp {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@functools.cache
def _app(names: tuple[str, ...], *, texts: bool = True) -> Any:
    """The command line, made once; of other commands than these it knows the names: to import all takes long.

    `texts`: whether options have their texts, which are read in the sources.
    """
    app = typer.Typer(
        name="eadp",
        cls=_Grouped,
        help="Plan the flight and the onboard computing of a battery-powered fixed-wing robot together.\n\n"
        "Example: eadp simulate plans/survey.plan --scenario scenarios/paper-i-dynamic.yaml -o runs/i",
        rich_markup_mode=None,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_options)
    for name in (*COMMANDS, *(name for name in names if name not in COMMANDS)):
        # of a command that is not run only the name counts
        command = grouped(plug_in("commands", name), texts=texts) if name in names else lambda: NO
        app.command(name, cls=_Sectioned, short_help=COMMANDS.get(name, ADDED))(_shielded(command))
    return typer.main.get_command(app)


# typer brings a click of its own in some versions, and uses the installed one in others: errors are found by ancestry
_UsageFault = next(base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException")


def main(arguments: list[str]) -> int:
    """Run one command line; return its exit code (0 yes, 1 no, 2 bad input, 70 a bug, 130 interrupted)."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # what a terminal cannot show is escaped
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        # those that a shell completes: bash's words, and what typer's scripts for other shells hand over
        shown = os.environ.get("COMP_WORDS", os.environ.get("_TYPER_COMPLETE_ARGS", "")).split()[1:]
        first = [name for name in (*arguments[:1], *shown[:1]) if not name.startswith("-")]
        named = tuple(name for name in first if name in COMMANDS or name in added_names("commands"))
        texts = "_EADP_COMPLETE" in os.environ or not {"-h", "--help"}.isdisjoint(arguments)
        result = _app(named, texts=texts)(args=arguments, prog_name="eadp", standalone_mode=False)
        sys.stdout.flush()
        if result == INTERRUPTED:  # typer's own answer, outside of a command
            return _interrupted()
        return result if isinstance(result, int) else YES
    except typer.Exit as stop:
        return stop.exit_code
    except (typer.Abort, KeyboardInterrupt):
        return _interrupted()
    except (BrokenPipeError, _Closed):
        _drop_output()  # the reader has seen enough
        return YES
    except Exception as error:
        if os.environ.get("EADP_DEBUG") == "1":
            traceback.print_exc()
        return _failed(error)


def _failed(error: Exception) -> int:
    """The exit code of an error, which is said on stderr."""
    if isinstance(error, EadpError):
        sys.stderr.write(faults_text(error.faults) if isinstance(error, InputError) else _plain(str(error)))
        return BAD_INPUT
    if isinstance(error, (OSError, MemoryError)):
        return _exhausted(error)
    if isinstance(error, _UsageFault):
        return _usage(error)
    if _follows_interrupt(error):
        return _interrupted()
    what = f"{type(error).__name__}: {error}"
    print(f"eadp: this is a bug, please report it: {what} (EADP_DEBUG=1 shows where)", file=sys.stderr)  # noqa: T201
    return BUG


_NO_NUMBER = "Input should be a valid number, unable to parse string as a number"


def _interrupted() -> int:
    print("eadp: interrupted", file=sys.stderr)  # noqa: T201
    return INTERRUPTED


def _follows_interrupt(error: BaseException | None) -> bool:
    """Whether an error came of an interrupt, as of one within the import of a compiled module."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _exhausted(error: OSError | MemoryError) -> int:
    """Something that the machine does not have or do: space on the device of standard output, memory."""
    if isinstance(error, MemoryError):
        what = f"not enough memory: {error}"
    else:
        _drop_output()
        what = f"{printable(str(error.filename or 'standard output'))} cannot be written: {error.strerror}"
    sys.stderr.write(_plain(what))
    return BAD_INPUT


def _drop_output() -> None:
    """Nothing more may be written, not even by the interpreter's last flush."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _usage(error: Exception) -> int:
    """A command line that cannot be read, or no command at all, which is answered with the help."""
    message = getattr(error, "format_message", lambda: str(error))().replace("Value error, ", "")
    message = message.replace(_NO_NUMBER, "is no number; expected one with a decimal point, as in 6.3")
    if type(error).__name__ == "NoArgsIsHelpError":
        print(message)  # noqa: T201
        return YES
    if type(error).__name__ == "MissingParameter":  # the first line of each command's help is an example
        example = (error.ctx.command.help or "").partition("\n")[0]  # type: ignore[attr-defined]
        message = f"{message} {example}"
    if type(error).__name__ == "NoSuchOption":
        message = _pipe(error) or message
    sys.stderr.write(_plain(message))
    return BAD_INPUT


def _plain(message: str) -> str:
    return escaped(f"eadp: error: {message}\n")


def _pipe(error: Any) -> str:
    """What to type in place of an option that `eadp plan` has for all commands that read a plan; else empty."""
    from eadp.cli.plan import CHANGES

    name = error.option_name
    moved = name.lstrip("-") in (*CHANGES, "min-radius")
    if not moved or all(each.metavar != "PLAN" for each in error.ctx.command.params):
        return ""
    return f"{name} is an option of eadp plan: eadp plan PLAN {name} … | eadp {error.ctx.info_name} -"
