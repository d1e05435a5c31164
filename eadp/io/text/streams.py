"""Text in, files out: `-`, size limits, kinds of files, and writes that happen whole or not at all."""

from __future__ import annotations

import codecs
import errno
import json
import os
import re
import shutil
import stat
import sys
import tempfile
from array import array
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from pathlib import Path

from eadp.errors import Fault, InputError, printable

LIMIT_BYTES = 20_000_000
"""Size limit of inputs."""


Location = tuple[int, int]
"""Line and column, from 1."""


@dataclass(frozen=True)
class Text:
    """A text and the name to call it by in messages."""

    name: str
    body: str

    @cached_property
    def lines(self) -> list[str]:
        """Its lines."""
        return self.body.split("\n")

    @cached_property
    def starts(self) -> Sequence[int]:
        """Offsets of the lines; an array, since a text may be all line ends."""
        return array("q", accumulate((len(line) + 1 for line in self.lines), initial=0))

    def location(self, offset: int) -> Location:
        """Line and column of an offset."""
        line = bisect_right(self.starts, offset, hi=len(self.lines))
        return line, offset - self.starts[line - 1] + 1

    def fault(self, location: Location, message: str, expected: str = "") -> Fault:
        """A fault at a location, with the line it is in."""
        line, column = location
        source = self.lines[line - 1] if line <= len(self.lines) else ""
        return Fault(self.name, line, column, message, expected, source)

    def error(self, location: Location, message: str, expected: str = "") -> InputError:
        """The error of a single fault at a location, to be raised."""
        return InputError(self.fault(location, message, expected))


def read_text(path: str) -> Text:
    """Read a UTF-8 file, or standard input for `-`; a BOM is dropped and CRLF becomes LF.

    Raises
    ------
    InputError
        At 1:1, if there is no such file, it is a folder, is larger than the limit, or is not UTF-8.
    """
    name = "<stdin>" if path == "-" else path
    try:
        if path == "-":
            data = sys.stdin.buffer.read(LIMIT_BYTES + 1)
        else:
            with open(path, "rb") as stream:
                data = stream.read(LIMIT_BYTES + 1)
    except IsADirectoryError:
        raise InputError.at(name, 1, 1, "is a folder", "a file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError.at(name, 1, 1, f"cannot be read: {reason}", "a readable file") from None
    return text_of(name, data)


def text_of(name: str, data: bytes) -> Text:
    """The text that the bytes of a file are. Raises InputError as `read_text`."""
    if len(data) > LIMIT_BYTES:
        raise InputError.at(name, 1, 1, "is too large", f"at most {LIMIT_BYTES} bytes")
    try:
        body = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # the decoder counts from after a byte order mark
        offset = error.start + (3 if data.startswith(codecs.BOM_UTF8) else 0)
        message = f"is not UTF-8 text: byte 0x{data[offset]:02x} at offset {offset}"
        wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        raise InputError.at(name, 1, 1, message, "UTF-8 text, not UTF-16" if wide else "UTF-8 text") from None
    if "\0" in body:
        raise InputError.at(name, 1, 1, "is no text: it has a byte of 0", "UTF-8 text")
    return Text(name, body.replace("\r\n", "\n").replace("\r", "\n"))


def write_text(path: str, body: str) -> None:
    """Write a text file whole or not at all; `-` is standard output. Raises as `write_bytes`."""
    if path == "-":
        sys.stdout.write(body)
    else:
        write_bytes(path, body.encode("utf-8"))


def output_file(path: str) -> Path:
    """The regular file that an output goes to: a link is followed to its end.

    Raises
    ------
    InputError
        If the name is empty, or something that is no regular file has it: a folder, a device, a pipe.
    """
    mode = _mode(path)
    if mode is not None and (not stat.S_ISREG(mode) or os.path.dirname(os.path.abspath(path)) in _STREAMS):
        what = "a folder" if stat.S_ISDIR(mode) else "no regular file"
        raise InputError.at(path, 1, 1, f"cannot be written: {what}", "a file; - is standard output")
    return Path(os.path.realpath(path))


FILES, FILES_SCHEMA = "files.json", "eadp.files/1"
"""In a folder that eadp wrote: the names of all its files, which are what is replaced; and the schema of that."""

_STREAMS = ("/dev", "/dev/fd", f"/proc/{os.getpid()}/fd", "/proc/self/fd")
"""Folders whose regular files are open streams."""
_PREFIX = ".eadp."
"""Start of temporary names, whatever the length of the name that they become."""


def _mode(path: str) -> int | None:
    """Kind and permissions of what has a name; None if nothing has it. Raises InputError."""
    try:
        if not path:
            raise ValueError("the name is empty")
        return os.stat(path).st_mode
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        if getattr(error, "errno", None) == errno.ENOENT:
            return None
        raise _unwritable(path, error) from None


def _unwritable(path: str, error: Exception) -> InputError:
    reason = getattr(error, "strerror", None) or str(error)
    return InputError.at(path, 1, 1, f"cannot be written: {reason}", "a writable location")


def write_bytes(path: str, body: bytes) -> None:
    """Write a file whole or not at all, through a link to it.

    Raises
    ------
    InputError
        If the location cannot be written to, or is no regular file.
    """
    target = output_file(path)
    temporary = ""
    try:
        with tempfile.NamedTemporaryFile(dir=target.parent, prefix=_PREFIX, delete=False) as stream:
            temporary = stream.name
            stream.write(body)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, target)
    except OSError as error:
        raise _unwritable(path, error) from None
    finally:
        if temporary and os.path.exists(temporary):
            os.unlink(temporary)


@contextmanager
def new_folder(path: str, *, force: bool) -> Iterator[Path]:
    """A folder that appears under its name only when the block succeeds.

    Yields a temporary sibling to fill; lists its files, and renames it at the end; removes it when the block raises.

    Raises
    ------
    InputError
        As `check_new_folder`, or if the place cannot be written to.
    """
    check_new_folder(path, force=force)
    target = Path(os.path.realpath(path))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=_PREFIX))
        os.chmod(temporary, 0o777 & ~_umask())
    except OSError as error:
        raise _unwritable(path, error) from None
    try:
        yield temporary
        files = sorted(each.relative_to(temporary).as_posix() for each in temporary.rglob("*") if each.is_file())
        listed = json.dumps({"schema": FILES_SCHEMA, "files": [*files, FILES]}, indent=1)
        (temporary / FILES).write_text(f"{listed}\n", encoding="utf-8")
        check_new_folder(path, force=force)  # again: something may have come meanwhile
        if target.exists():
            _swap(temporary, target)
        else:
            temporary.rename(target)
    except OSError as error:
        raise _unwritable(path, error) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_new_folder(path: str, *, force: bool) -> None:
    """Refuse a result folder's name that is taken, before any work is done for it.

    Raises
    ------
    InputError
        If something stands there and is not a folder, or is a folder and `force` is not set; with `force` if it has
        anything that eadp did not write there, or the process is within it.
    """
    mode = _mode(path)
    if mode is None:
        return
    if not stat.S_ISDIR(mode):
        raise InputError.at(path, 1, 1, "is a file", "a folder")
    if not force:
        raise InputError.at(path, 1, 1, "exists already", "a new folder, or --force to replace it")
    try:
        stranger, here = _stranger(Path(path)), Path.cwd()
    except OSError as error:
        raise _unwritable(path, error) from None
    if stranger is not None:
        message = f"holds {printable(stranger)}, which is no file of a result of eadp, and is not replaced"
        raise InputError.at(path, 1, 1, message, f"a new folder, or one whose {FILES} lists all that it holds")
    if Path(os.path.realpath(path)) in (here, *here.parents):
        raise InputError.at(path, 1, 1, "is the working folder, or holds it, and is not replaced", "another folder")


def _stranger(folder: Path) -> str | None:
    """The first name in a folder that its list of files does not have; no link is in it."""
    try:
        document = json.loads(read_text(str(folder / FILES)).body)
        files = {Path(name) for name in document["files"] if document["schema"] == FILES_SCHEMA}
    except (InputError, LookupError, RecursionError, TypeError, ValueError):
        files = set()
    known = files | {parent for file in files for parent in file.parents}
    found = ((path.relative_to(folder), path.is_symlink()) for path in sorted(folder.rglob("*")))
    return next((str(name) for name, is_link in found if is_link or name not in known), None)


def _swap(new: Path, target: Path) -> None:
    """Put `new` where `target` stands; a crash between the two renames leaves both on disk."""
    old = Path(tempfile.mkdtemp(dir=target.parent, prefix=f"{_PREFIX}old."))
    target.rename(old / "replaced")
    new.rename(target)
    shutil.rmtree(old, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


_SCHEMA = re.compile(r"^schema: *['\"]?eadp\.([a-z]+)/", re.MULTILINE)
_FIELD = re.compile(r"\s*(<\?xml[^>]*>\s*)?<kml|\s*\{.{0,2000}?\"type\"\s*:\s*\"(Feature|Polygon|Multi)", re.DOTALL)
HEAD = 4000
"""Characters of a file in which its kind is searched."""


def refuse_others(text: Text) -> None:
    """Refuse a file that stands where a plan belongs: a field, a YAML file of eadp's, a file of other software.

    Raises
    ------
    InputError
        With what takes such a file, or is read.
    """
    head = text.body[:HEAD]
    if _FIELD.match(head):
        expected = f"a plan, which eadp cover {printable(text.name)} makes of it"
        raise InputError.at(text.name, 1, 1, "is a field, not a plan", expected)
    if found := _SCHEMA.search(head):
        raise InputError.at(text.name, 1, 1, f"is a file of eadp.{found[1]}, not a plan", "a plan")
    if head.lstrip().startswith("<"):
        expected = "a plan; a mission as WPL (*.waypoints) or a plan of QGroundControl"
        raise InputError.at(text.name, 1, 1, "is XML, of no kind that is read", expected)
