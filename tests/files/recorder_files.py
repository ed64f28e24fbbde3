"""Files of recorders, written byte by byte from the public descriptions of their formats."""

import struct

import numpy as np


def _text(text):
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def _property(name, value):
    if isinstance(value, str):
        return _text(name) + struct.pack("<I", 0x20) + _text(value)
    return _text(name) + struct.pack("<Id", 10, value)


def tdms(path, groups):
    """Write TDMS: `groups` are by name channels by name, each values and properties.

    One segment of contiguous doubles: lead-in, number of objects, and of each its path, index and properties.
    """
    objects, raw = [_text("/") + struct.pack("<I", 0xFFFFFFFF) + struct.pack("<I", 0)], b""
    for group, channels in groups.items():
        objects.append(_text(f"/'{group}'") + struct.pack("<I", 0xFFFFFFFF) + struct.pack("<I", 0))
        for name, (values, properties) in channels.items():
            index = struct.pack("<IIIQ", 20, 10, 1, len(values))
            stated = b"".join(_property(*item) for item in properties.items())
            objects.append(
                _text(f"/'{group}'/'{name}'") + index + struct.pack("<I", len(properties)) + stated
            )
            raw += np.asarray(values, dtype="<f8").tobytes()
    metadata = struct.pack("<I", len(objects)) + b"".join(objects)
    toc = 1 << 1 | 1 << 2 | 1 << 3  # metadata, new object list, raw data
    lead = b"TDSm" + struct.pack("<IIQQ", toc, 4713, len(metadata) + len(raw), len(metadata))
    path.write_bytes(lead + metadata + raw)
    return path


class _Blocks:
    """Blocks of an MDF 4 file: id, reserved, length, number of links, links, data."""

    def __init__(self):
        self.content = bytearray(
            struct.pack("<8s8s8s4sH30sHH", b"MDF     ", b"4.10    ", b"by hand ", b"", 410, b"", 0, 0)
        )

    def add(self, kind, links, data):
        self.content += bytes(-len(self.content) % 8)
        at, length = len(self.content), 24 + 8 * len(links) + len(data)
        self.content += struct.pack("<4s4xQQ", b"##" + kind, length, len(links))
        self.content += struct.pack(f"<{len(links)}Q", *links) + data
        return at

    def link(self, at, number, to):
        struct.pack_into("<Q", self.content, at + 24 + 8 * number, to)

    def text(self, text):
        data = text.encode() + b"\0"
        return self.add(b"TX", [], data + bytes(-len(data) % 8))


def mf4(path, times, channels):
    """Write MDF 4 with a group of doubles: `channels` are by name values, unit and factor of a conversion."""
    blocks = _Blocks()
    head = blocks.add(b"HD", [0] * 6, struct.pack("<Qhh4B2d", 0, 0, 0, 0, 0, 0, 0, 0.0, 0.0))
    columns = {"t": (times, "s", 1.0), **channels}
    record = np.column_stack([values / factor for values, _, factor in columns.values()]).astype("<f8")
    first = previous = 0
    for number, (name, (_, unit, factor)) in enumerate(columns.items()):
        conversion = 0
        if factor != 1:  # linear: offset and factor
            conversion = blocks.add(
                b"CC", [0] * 4, struct.pack("<BBHHHdddd", 1, 0, 0, 0, 2, 0, 0, 0.0, factor)
            )
        links = [0, 0, blocks.text(name), 0, conversion, 0, blocks.text(unit), 0]
        master = number == 0
        data = struct.pack(
            "<4BIIIIBxHdddddd",
            *(2 if master else 0, 1 if master else 0, 4, 0, 8 * number, 64, 0, 0, 0, 0),
            *(0.0,) * 6,
        )
        channel = blocks.add(b"CN", links, data)
        if previous:
            blocks.link(previous, 0, channel)
        first, previous = first or channel, channel
    group = blocks.add(
        b"CG", [0, first, 0, 0, 0, 0], struct.pack("<QQHHIII", 0, len(times), 0, 0, 0, 8 * len(columns), 0)
    )
    data = blocks.add(b"DT", [], record.tobytes())
    blocks.link(head, 0, blocks.add(b"DG", [0, group, data, 0], bytes(8)))
    path.write_bytes(bytes(blocks.content))
    return path
