"""Text in, files out: encodings, limits, and writes that happen whole or not at all."""

import io
import json
import os
import sys

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eadp.errors import InputError
from eadp.io.text import streams
from eadp.io.text.streams import FILES, Text, check_new_folder, new_folder, read_text, write_text

unhurried = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


def written(folder, data, name="a.txt"):
    path = folder / name
    path.write_bytes(data)
    return str(path)


def fault_of(action, *arguments, **options):
    """The one fault, at 1:1, that an action is refused with."""
    with pytest.raises(InputError) as caught:
        action(*arguments, **options)
    (fault,) = caught.value.faults
    assert (fault.line, fault.column, fault.severity) == (1, 1, "error")
    return fault


# --- reading ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "data", [b"a\nb\n", b"a\r\nb\r\n", b"a\rb\r", b"\xef\xbb\xbfa\nb\n", b"\xef\xbb\xbfa\r\nb\r\n"]
)
def test_bom_and_line_ends(tmp_path, data):
    assert read_text(written(tmp_path, data)).body == "a\nb\n"


def test_standard_input(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"\xef\xbb\xbf1;\r\n2"), encoding="ascii"))
    assert read_text("-") == Text("<stdin>", "1;\n2")


def test_a_file_that_is_not_there(tmp_path):
    fault = fault_of(read_text, str(tmp_path / "none.plan"))
    assert fault.message == "cannot be read: No such file or directory"
    assert str(fault).startswith(f"{tmp_path / 'none.plan'}:1:1: error: cannot be read: ")


@pytest.mark.parametrize("path", ["", "a\0b", "x" * 5000])
def test_a_name_that_no_file_can_have(path):
    assert fault_of(read_text, path).message.startswith("cannot be read: ")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"ab\xff", "byte 0xff at offset 2"),
        ("\ufefft;W".encode("utf-16-le"), "byte 0xff at offset 0"),  # as of a spreadsheet
        (b"\xe9t\xe9", "byte 0xe9 at offset 0"),
        (b"ok\n\xc3", "byte 0xc3 at offset 3"),
        (b"\xed\xa0\x80", "byte 0xed at offset 0"),  # half of a surrogate pair
    ],
)
def test_what_is_not_utf_8(tmp_path, data, said):
    fault = fault_of(read_text, written(tmp_path, data))
    assert fault.message == f"is not UTF-8 text: {said}"
    assert fault.expected == ("UTF-8 text, not UTF-16" if data.startswith(b"\xff\xfe") else "UTF-8 text")


@unhurried
@given(st.binary(max_size=60))
def test_any_bytes_are_read_or_refused(tmp_path, data):
    path = written(tmp_path, data)
    try:
        body = data.decode("utf-8")
    except UnicodeDecodeError:
        assert fault_of(read_text, path).message.startswith("is not UTF-8 text: byte 0x")
        return
    if "\0" in body:
        assert fault_of(read_text, path).message == "is no text: it has a byte of 0"
        return
    # Python's own universal newlines, and its own idea of a BOM
    wanted = io.StringIO(body.removeprefix("\ufeff"), newline=None).read()
    assert read_text(path).body == wanted


# --- limits -----------------------------------------------------------------------------------------------------------


def test_the_limit_and_one_byte_more(tmp_path, monkeypatch):
    monkeypatch.setattr(streams, "LIMIT_BYTES", 10)
    assert read_text(written(tmp_path, b"0123456789")).body == "0123456789"
    fault = fault_of(read_text, written(tmp_path, b"0123456789a"))
    assert (fault.message, fault.expected) == ("is too large", "at most 10 bytes")


def test_the_limit_of_standard_input_stops_reading(monkeypatch):
    class Endless(io.RawIOBase):
        def readable(self):
            return True

        def readinto(self, buffer):
            buffer[:] = b"x" * len(buffer)
            return len(buffer)

    monkeypatch.setattr(streams, "LIMIT_BYTES", 1000)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BufferedReader(Endless())))
    fault = fault_of(read_text, "-")
    assert (fault.file, fault.message) == ("<stdin>", "is too large")


# --- files ------------------------------------------------------------------------------------------------------------


def test_a_file_is_written_and_replaced(tmp_path):
    path = tmp_path / "a.txt"
    write_text(str(path), "ε\n")
    assert path.read_bytes() == "ε\n".encode()
    write_text(str(path), "b\n")
    assert path.read_bytes() == b"b\n"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_file_has_the_mode_that_open_would_give(tmp_path):
    before = os.umask(0o027)
    try:
        write_text(str(tmp_path / "a.txt"), "")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def test_a_write_that_breaks_off_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(streams.os, "replace", full)
    fault = fault_of(write_text, str(path), "new")
    assert fault.message == "cannot be written: No space left on device"
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_places_that_cannot_be_written_to(tmp_path):
    for path in (tmp_path / "none" / "a.txt", tmp_path):
        assert fault_of(write_text, str(path), "x").message.startswith("cannot be written: ")
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("path", ["/dev/null", "/dev/stdout", "a\0b", "x" * 300, ""])
def test_what_is_no_regular_file_is_refused(path):
    assert fault_of(write_text, path, "x").message.startswith("cannot be written: ")
    assert not os.path.isfile("/dev/null")


def test_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert fault_of(write_text, str(tmp_path / "pipe"), "x").message == "cannot be written: no regular file"


def test_a_link_is_written_through(tmp_path):
    for name, content in (("old.txt", "old"), ("new.txt", None)):
        target, link = tmp_path / "deep" / name, tmp_path / f"link-{name}"
        target.parent.mkdir(exist_ok=True)
        if content is not None:
            target.write_text(content)
        link.symlink_to(target)
        write_text(str(link), "written")
        assert (link.is_symlink(), target.read_text()) == (True, "written")


@pytest.mark.parametrize("length", [200, 255])
def test_names_as_long_as_a_file_may_have(tmp_path, length):
    write_text(str(tmp_path / ("a" * length)), "x")
    with new_folder(str(tmp_path / ("b" * length)), force=False):
        pass
    with new_folder(str(tmp_path / ("b" * length)), force=True) as folder:
        (folder / "file").touch()
    assert sorted(map(len, os.listdir(tmp_path))) == [length, length]
    fault = fault_of(check_new_folder, str(tmp_path / ("b" * 256)), force=False)
    assert fault.message == "cannot be written: File name too long"


# --- folders ----------------------------------------------------------------------------------------------------------


def test_a_folder_appears_when_the_block_has_ended(tmp_path):
    target = tmp_path / "runs" / "i"
    with new_folder(str(target), force=False) as folder:
        (folder / "flight.csv").write_text("x")
        assert not target.exists()
        assert folder.parent == target.parent
    assert (target / "flight.csv").read_text() == "x"
    assert json.loads((target / FILES).read_text()) == {"schema": "eadp.files/1", "files": ["flight.csv", FILES]}
    assert os.listdir(target.parent) == ["i"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
@pytest.mark.parametrize("force", [False, True])
def test_a_block_that_raises_leaves_nothing(tmp_path, error, force):
    target = tmp_path / "i"
    if force:
        with new_folder(str(target), force=False) as folder:
            (folder / "old").write_text("old")

    def block():
        with new_folder(str(target), force=force) as folder:
            (folder / "flight.csv").write_text("half")
            raise error

    with pytest.raises(error):
        block()
    assert os.listdir(tmp_path) == (["i"] if force else [])
    if force:
        assert sorted(os.listdir(target)) == [FILES, "old"]


def test_a_taken_name_is_refused_or_replaced(tmp_path):
    target = tmp_path / "i"
    with new_folder(str(target), force=False) as folder:
        (folder / "old").write_text("old")
    fault = fault_of(check_new_folder, str(target), force=False)
    assert (fault.message, fault.expected) == ("exists already", "a new folder, or --force to replace it")
    with new_folder(str(target), force=True) as folder:
        (folder / "new").write_text("new")
        assert sorted(os.listdir(target)) == [FILES, "old"], "until the block has ended"
    assert sorted(os.listdir(target)) == [FILES, "new"]
    assert os.listdir(tmp_path) == ["i"]


@pytest.mark.parametrize("force", [False, True])
def test_what_comes_while_a_folder_is_filled_is_not_replaced(tmp_path, force):
    target = tmp_path / "i"

    def block():
        with new_folder(str(target), force=force) as folder:
            (folder / "new").write_text("new")
            target.mkdir()
            (target / "mine").write_text("mine")

    assert fault_of(block).message.startswith("holds mine, which is no file" if force else "exists already")
    assert (os.listdir(tmp_path), os.listdir(target)) == (["i"], ["mine"])


@pytest.mark.parametrize(
    "text",
    ["[" * 10**5, '{"files": ["old", "files.json"]}', '{"schema": "eadp.files/1", "files": [1, "../i/old", "../old"]}'],
)
def test_a_damaged_list_of_files_protects_all(tmp_path, text):
    (tmp_path / "old").write_text("old")
    (tmp_path / "i").mkdir()
    (tmp_path / "i" / FILES).write_text(text)
    (tmp_path / "i/old").write_text("old")
    assert fault_of(check_new_folder, str(tmp_path / "i"), force=True).message.startswith("holds ")


def tree(folder):
    """All that lies in a folder, with its content."""
    return {path: path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))}


@pytest.mark.parametrize("stranger", ["notes.txt", "inputs/notes.txt", "sub/empty", "link"])
def test_the_first_stranger_in_a_result_is_named(tmp_path, stranger):
    target = tmp_path / "result"
    with new_folder(str(target), force=False) as folder:
        (folder / "inputs").mkdir()
        for name in ("flight.csv", "inputs/a.plan"):
            (folder / name).write_text("x")
    if stranger == "link":
        (target / "flight.csv").unlink()
        (target / "flight.csv").symlink_to(__file__)
    elif stranger == "sub/empty":
        (target / stranger).mkdir(parents=True)
    else:
        (target / stranger).write_text("mine")
    before, named = tree(target), {"link": "flight.csv", "sub/empty": "sub"}.get(stranger, stranger)
    message = fault_of(check_new_folder, str(target), force=True).message
    assert message.startswith(f"holds {named}, which is no file of a result")
    assert tree(target) == before


def test_the_working_folder_is_not_replaced(tmp_path, monkeypatch):
    (tmp_path / "home/result").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "home/result")
    monkeypatch.chdir(tmp_path / "home/result")
    for place in (".", "../../link"):
        assert fault_of(check_new_folder, place, force=True).message.startswith("is the working folder")
    assert fault_of(check_new_folder, "..", force=True).message.startswith("holds result, which")


def test_a_file_is_no_folder_even_by_force(tmp_path):
    path = written(tmp_path, b"x")
    for force in (False, True):
        assert fault_of(check_new_folder, path, force=force).message == "is a file"
    check_new_folder(str(tmp_path / "free"), force=False)
