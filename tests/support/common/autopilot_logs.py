"""Autopilots' own logs, made byte by byte."""

import struct

KINDS = {"Q": "uint64_t", "d": "double", "f": "float", "B": "uint8_t", "H": "uint16_t"}
CODES = {"Q": "Q", "B": "B", "f": "f", "d": "d", "L": "i", "H": "H"}


def ulog(tables):
    """A ULog: topics with their fields, as in `Qff`, and rows; the time [µs] is the first field."""
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)]

    def add(kind, body):
        parts.append(struct.pack("<HB", len(body), ord(kind)) + body)

    add("B", bytes(40))
    for name, (types, fields, _) in tables.items():
        add("F", f"{name}:{''.join(f'{KINDS[t]} {f};' for t, f in zip(types, fields, strict=True))}".encode())
    for number, name in enumerate(tables):
        add("A", struct.pack("<BH", 0, number) + name.encode())
    rows = [
        (row[0], number, struct.pack("<H" + types, number, *row))
        for number, (types, _, found) in enumerate(tables.values())
        for row in found
    ]
    for _, _, data in sorted(rows):
        add("D", data)
    return b"".join(parts)


def dataflash(tables):
    """A DataFlash log of such tables."""

    def packed(number, types, row):
        return b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(CODES[t] for t in types), *row)

    head = b"\xa3\x95\x80"
    own = struct.pack("<BB4s16s64s", 0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    parts, rows = [head + own], []
    for number, (name, (types, fields, found)) in enumerate(tables.items(), 0x81):
        length = 3 + struct.calcsize("<" + "".join(CODES[t] for t in types))
        names = ",".join(fields)
        parts.append(head + struct.pack("<BB4s16s64s", number, length, name.encode(), types.encode(), names.encode()))
        rows += [(row[0], number, packed(number, types, row)) for row in found]
    return b"".join(parts + [data for _, _, data in sorted(rows)])
