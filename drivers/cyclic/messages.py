"""What service and sender process say to each other through its standard input and output.

Downwards: a line of JSON with the plan, then messages of a letter, a length and that many bytes. Upwards:
lines of JSON.
"""

from __future__ import annotations

import array
import json
import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from drivers.bus.base import Beside
from drivers.cyclic.pace import Lateness
from drivers.cyclic.playback import Cause, Row
from drivers.cyclic.sender import CyclePlan, Phase, Report, Track

ROWS, FINISH, GO, BRAKE = b"R", b"F", b"G", b"B"
_HEAD = struct.Struct("<cI")


def pack_plan(plan: CyclePlan, way: Beside) -> bytes:
    """The first line downwards."""
    said = {
        "way": [way.interface, way.channel, way.host, way.port],
        "period": plan.period,
        "start": list(plan.start),
        "tracks": [[t.cob_id, t.head.hex(), t.braking, t.steepest] for t in plan.tracks],
        "reserve": plan.reserve,
        "capacity": plan.capacity,
    }
    return json.dumps(said).encode("ascii") + b"\n"


def unpack_plan(line: bytes) -> tuple[CyclePlan, Beside]:
    """See `pack_plan`."""
    said = json.loads(line)
    tracks = tuple(Track(cob_id, bytes.fromhex(head), *rates) for cob_id, head, *rates in said["tracks"])
    plan = CyclePlan(said["period"], tuple(said["start"]), tracks, said["reserve"], said["capacity"])
    return plan, Beside(*said["way"])


def pack(kind: bytes, payload: bytes = b"") -> bytes:
    """A message downwards."""
    return _HEAD.pack(kind, len(payload)) + payload


def pack_rows(rows: Sequence[Row]) -> bytes:
    """The message with these rows: doubles, little-endian."""
    values = array.array("d", [value for row in rows for value in row])
    if sys.byteorder == "big":
        values.byteswap()
    return pack(ROWS, values.tobytes())


def unpack_rows(payload: bytes, axes: int) -> list[Row]:
    """See `pack_rows`."""
    values = array.array("d")
    values.frombytes(payload)
    if sys.byteorder == "big":
        values.byteswap()
    return [tuple(values[at : at + axes]) for at in range(0, len(values), axes)]


class Inbox:
    """Bytes as they come, messages as they are whole."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def take(self, piece: bytes) -> Iterator[tuple[bytes, bytes]]:
        """Kind and payload of each message that is whole now."""
        held = self._bytes
        held += piece
        while len(held) >= _HEAD.size:
            kind, length = _HEAD.unpack_from(held)
            end = _HEAD.size + length
            if len(held) < end:
                return
            payload = bytes(held[_HEAD.size : end])
            del held[:end]
            yield kind, payload


def pack_report(report: Report, *, whole: bool) -> bytes:
    """A line upwards; the histogram only with the `whole` of it."""
    said: dict[str, Any] = {
        "phase": report.phase,
        "cycles": report.cycles,
        "taken": report.taken,
        "slips": report.slips,
        "cause": report.cause,
        "abrupt": report.abrupt,
        "why": report.why,
        "longest": report.lateness.longest,
        "counts": report.lateness.counts if whole else {},
    }
    return json.dumps(said).encode("ascii") + b"\n"


def unpack_report(line: bytes) -> Report:
    """See `pack_report`. Raises ValueError, KeyError or TypeError for what is none."""
    said: Mapping[str, Any] = json.loads(line)
    counts = {int(bucket): int(count) for bucket, count in said["counts"].items()}
    return Report(
        Phase(said["phase"]),
        said["cycles"],
        said["taken"],
        said["slips"],
        Cause(said["cause"]),
        said["abrupt"],
        Lateness(counts, said["longest"]),
        said["why"],
    )
