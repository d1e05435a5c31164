"""The door to pymavlink on a link: addresses, frames in, frames out. It opens no address but the one given.

Source: the MAVLink 2 serialisation (mavlink.io, "Packet Serialization"), decoded by pymavlink's dialect of ArduPilot,
which has the common messages as well.
"""

from __future__ import annotations

import contextlib
import importlib.util
import math
import os
import re
import stat
import sys
import time
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from eadp.errors import InputError, printable

COMPONENT = 191
"""MAVLink's number of a companion computer."""

ALLOWED = ("udpin:", "udpout:", "tcp:", "tcpin:")
CLIENT_S = 10.0
"""Time after which a sender that says no more is written to no more [s]."""

MARKS = {0xFD: (12, 10), 0xFE: (8, 6)}
"""First bytes of frames of MAVLink 2 and 1: the bytes of a frame beside its payload, and of these the header's."""
TLOG_HEAD = 8
"""Bytes of the time before each frame of a telemetry log."""
MARK = re.compile(b"[%b]" % bytes(MARKS))
SIGNED_BYTES = 13
"""Bytes of a signature, at the end of a frame."""
CHUNK_BYTES = 2048
"""Most of a datagram that is read: a frame has 280 bytes at most, and a datagram as many as fit the link."""
READING_SHARE, BATCH_S = 0.02, 1e-3
"""Share of a core that reading takes at most, however much is sent, and about how long it works in one go [s]."""
MAX_SENDERS = 8
"""Most addresses that are written to: each that sends to a port that listens is one."""


class Message(NamedTuple):
    """A message: its name, who sent it, and its fields."""

    kind: str
    system: int
    component: int
    fields: Mapping[str, Any]


class Codec:
    """Frames to messages and back.

    Parameters
    ----------
    wanted : set of str
        Names of the messages to decode; others are passed over by their numbers.
    stream : bool
        Whether a frame may arrive in parts; else each part is a datagram of whole frames.
    """

    def __init__(self, wanted: frozenset[str], *, stream: bool = False) -> None:
        from pymavlink.dialects.v20 import ardupilotmega

        self._dialect, self._stream = ardupilotmega, stream
        self._mav = ardupilotmega.MAVLink(None, srcSystem=255, srcComponent=COMPONENT)
        known = ardupilotmega.mavlink_map.items()
        self._wanted = frozenset(number for number, message in known if message.msgname in wanted)
        self._rest = b""

    def decoded(self, data: bytes) -> Iterator[Message]:
        """The messages wanted among bytes that have come.

        Bytes between frames are passed over. The start of a frame is kept for the next call on a stream, and passed
        over where each part is a datagram.
        """
        data, start = self._rest + data, 0
        self._rest = b""
        while (found := MARK.search(data, start)) is not None:
            start = found.start()
            size, number = _frame(data, start)
            if start + size > len(data):
                if self._stream:
                    self._rest = data[start:]
                    return
                start += 1
                continue
            if number is None or number in self._wanted:
                message = self._message(data[start : start + size])
                if message is None:  # what looked like the start of a frame was none
                    start += 1
                    continue
                yield message
            start += size

    def _message(self, frame: bytes) -> Message | None:
        """The message of a frame; None where the frame is damaged."""
        try:
            decoded = self._mav.decode(bytearray(frame))
            fields = {name: getattr(decoded, name) for name in decoded.get_fieldnames()}
        except Exception:  # pymavlink trusts what a frame says of itself
            return None
        return Message(decoded.get_type(), decoded.get_srcSystem(), decoded.get_srcComponent(), fields)

    def encoded(self, system: int, kind: str, values: Mapping[str, Any]) -> bytes:
        """A frame of a message, sent as a component of a system."""
        message = getattr(self._dialect, f"MAVLink_{kind.lower()}_message")(**values)
        self._mav.srcSystem = system
        frame = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame


def _frame(data: bytes, start: int) -> tuple[int, int | None]:
    """Length in bytes of the frame that starts at `start`, and its message's number; 0 and None where none starts.

    Where the header has not come whole, the header's length and None.
    """
    if data[start] not in MARKS:
        return 0, None
    beside, header = MARKS[data[start]]
    # the second byte is the length of the payload; the third, of MAVLink 2, has a flag for a signature
    if start + header > len(data):
        return header, None
    size = data[start + 1] + beside
    if header == 6:
        return size, data[start + 5]
    signed = SIGNED_BYTES * (data[start + 2] & 1)
    return size + signed, int.from_bytes(data[start + 7 : start + 10], "little")


def require_pymavlink(option: str, value: str) -> None:
    """Refuse an option where pymavlink is not installed."""
    if importlib.util.find_spec("pymavlink") is None:
        raise InputError.at(option, 1, 1, "pymavlink is missing", "pip install 'eadp[mavlink]'", value)


class Link:
    """An open address.

    Parameters
    ----------
    address : str
        As pymavlink names it: `udpin:HOST:PORT`, `udpout:…`, `tcp:…`, `tcpin:…`, or a serial device, with its rate as
        in `/dev/ttyACM0,57600`.
    wanted : set of str
        Names of the messages to receive.

    Raises
    ------
    InputError
        If it is no such address, or cannot be opened.
    """

    def __init__(self, address: str, wanted: frozenset[str]) -> None:
        require_pymavlink("--mavlink", address)
        self._codec = Codec(wanted, stream=not address.startswith("udp"))
        self._pause_to_s = 0.0
        self._senders: set[Any] = set()
        given = _checked(address)
        from pymavlink import mavutil

        try:
            with contextlib.redirect_stdout(sys.stderr):  # it prints as it waits; standard output is for decisions
                self._port = mavutil.mavlink_connection(**given, autoreconnect=True, udp_timeout=CLIENT_S)
        except Exception as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise _fault(address, f"cannot be opened: {printable(reason)}") from None

    def receive(self, timeout_s: float) -> list[Message]:
        """The messages that come within a time [s], from the first on as many as `BATCH_S` of work reads.

        The next call starts with a pause, so that reading takes `READING_SHARE` of a core at most.
        """
        time.sleep(max(0.0, self._pause_to_s - time.monotonic()))
        messages: list[Message] = []
        begun_s, ends_s, came = time.thread_time(), time.monotonic() + timeout_s, False
        with contextlib.redirect_stdout(sys.stderr), contextlib.suppress(OSError):
            self._port.select(timeout_s)
            while time.thread_time() - begun_s < BATCH_S and (data := self._port.recv(CHUNK_BYTES)):
                came = True
                self._limit_senders()
                messages += self._codec.decoded(bytes(data))
        pause_s = (time.thread_time() - begun_s) / READING_SHARE
        # a device that is gone, or closed by its peer, fails at once, and does not wait
        self._pause_to_s = max(time.monotonic() + pause_s, 0.0 if came else ends_s)
        return messages

    def _limit_senders(self) -> None:
        """Write to `MAX_SENDERS` addresses at most: where more have sent, to the addresses known before.

        pymavlink writes to all of its set `clients`, which is changed here.
        """
        senders: set[Any] = getattr(self._port, "clients", set())
        if len(senders) > MAX_SENDERS:
            senders &= self._senders
        else:
            self._senders = set(senders)

    def send(self, system: int, kind: str, values: Mapping[str, Any]) -> None:
        """Send a message as a component of a system."""
        with contextlib.redirect_stdout(sys.stderr), contextlib.suppress(OSError):
            self._port.write(self._codec.encoded(system, kind, values))

    def close(self) -> None:
        """Close the address."""
        self._port.close()


def _checked(address: str) -> dict[str, Any]:
    """An address as pymavlink's arguments, refused unless it is of a kind in `ALLOWED` or a serial device.

    Of other names pymavlink would run some files, and take others for logs.
    """
    if address.startswith(ALLOWED):
        if not re.fullmatch(r"[a-z]+:[^:]+:[0-9]{1,5}", address):
            raise _fault(address, "is no address")
        return {"device": address}
    device, _, rate = address.partition(",")
    try:
        is_device = stat.S_ISCHR(os.stat(device).st_mode)
    except (OSError, ValueError):
        is_device = False
    if not is_device or not (rate == "" or rate.isdigit()):
        raise _fault(address, "is no address, and no serial device")
    return {"device": device, "baud": int(rate or 57600)}


def _fault(address: str, message: str) -> InputError:
    """The error of an address that is none, or cannot be opened."""
    expected = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or /dev/tty…,BAUD"
    return InputError.at("--mavlink", 1, 1, message, expected, address)


def is_tlog(head: bytes) -> bool:
    """Whether a file that starts so is one: a time of this century in microseconds, then a frame of MAVLink."""
    return len(head) > TLOG_HEAD and head[0] == 0 and 3 <= head[1] <= 8 and head[TLOG_HEAD] in MARKS


def tlog_messages(data: bytes, wanted: frozenset[str]) -> Iterator[Message]:
    """The messages wanted of a telemetry log: frames, each after its time; other bytes are passed over.

    A frame counts that another one, or the end of the file, follows.
    """
    codec, start = Codec(wanted), 0
    while start + TLOG_HEAD < len(data):
        size, _ = _frame(data, start + TLOG_HEAD)
        end = start + TLOG_HEAD + size
        following = end + TLOG_HEAD
        if size and end <= len(data) and (following >= len(data) or data[following] in MARKS):
            yield from codec.decoded(data[start + TLOG_HEAD : end])
            start = end
        else:
            start += 1


def is_number(value: Any) -> bool:
    """Whether a field is a number that is finite."""
    return isinstance(value, int | float) and math.isfinite(value)
