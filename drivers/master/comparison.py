"""A live node held against the object dictionary of its profile, by reading only."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from drivers.bus.base import Bus
from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.objects import Address
from drivers.cia301.sdo import AbortCode
from drivers.cia301.types import CodecError, DataType, Value, decode
from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile, ObjectKind, ObjectSpec
from drivers.errors import NodeAway, SdoAborted, SdoError, SdoTimeout, WrongIdentity
from drivers.master.ground.timing import Timing
from drivers.master.sdo.client import SdoClient

VENDOR: Final = Address(0x1018, 1)
PRODUCT: Final = Address(0x1018, 2)
_ERROR_REGISTER: Final = 0x1001
_PROFILE_AREA: Final = 0x6000
_FIXED_IN_PROFILE: Final = (0x6502, 0x67FF)
_SILENCES: Final = 3
"""Objects in a row without an answer after which the node counts as gone."""

_MISSING: Final = (AbortCode.NO_SUCH_OBJECT, AbortCode.NO_SUCH_SUB_INDEX)


class DifferenceKind(StrEnum):
    """In what an object differs."""

    MISSING = "missing"
    """The node has no such object or sub-index."""
    ACCESS = "access"
    """It can't be read though it should, or the other way round. Whether it can be written isn't tried."""
    NO_ANSWER = "no_answer"
    """The node did not answer to the read, twice, or broke the protocol."""
    LENGTH = "length"
    """It has another number of bytes, so another type."""
    CONSTANT = "constant"
    """It can't be written, and holds another value: identity, number of entries, supported modes."""
    RANGE = "range"
    """It holds a value that, by range or list of values, there is not."""
    SETTING = "setting"
    """It can be written, and holds another value than the default. Someone may have set it."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One object of the node that is not as its profile says."""

    address: Address
    name: str
    kind: DifferenceKind
    expected: str
    found: str


@dataclass(frozen=True, slots=True)
class Comparison:
    """What came out."""

    node: int
    model: str
    checked: int
    """Objects that were read, or tried to."""
    differences: tuple[Difference, ...]
    """What contradicts the profile, in the order of the objects."""
    settings: tuple[Difference, ...]
    """What is set to other values than the defaults; no contradiction."""
    foreign: int
    """Answers that were not for us: another master reads this node, or two nodes have its ID."""

    @property
    def agrees(self) -> bool:
        """Whether nothing contradicts the profile."""
        return not self.differences


async def compare(
    bus: Bus,
    node_id: int,
    catalog: Catalog,
    *,
    model: str | None = None,
    timing: Timing | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Read every object of a node and compare; nothing is written, no NMT command is sent.

    `bus` is open. The profile is that of `model`, or that whose identity the node has. `progress` is told how
    many objects of how many are done. Raises `NodeAway` if the node doesn't answer, `WrongIdentity` if no
    profile has its identity and `model` is left out, KeyError for an unknown model.
    """
    async with _reading(bus, node_id, timing or Timing()) as reader:
        profile = await _profile(reader, catalog) if model is None else catalog.profile(model)
        found = await _compare_all(reader, profile, progress)
    return Comparison(
        node=node_id,
        model=profile.model,
        checked=len(profile.objects),
        differences=tuple(one for one in found if one.kind is not DifferenceKind.SETTING),
        settings=tuple(one for one in found if one.kind is DifferenceKind.SETTING),
        foreign=reader.foreign,
    )


class _Reader:
    """Reads objects one by one; gives up on the node when it keeps silent."""

    def __init__(self, client: SdoClient, node_id: int) -> None:
        self.node_id = node_id
        self._client = client
        self._silences = 0

    @property
    def foreign(self) -> int:
        return self._client.counters.foreign + self._client.counters.late

    async def read(self, address: Address) -> bytes:
        """Raises `SdoError`, and `NodeAway` after several objects without an answer."""
        try:
            try:
                data = await self._client.upload(address)
            except SdoTimeout:  # a read may be repeated
                data = await self._client.upload(address)
        except SdoTimeout as error:
            self._silences += 1
            if self._silences == _SILENCES:
                raise NodeAway(f"node {self.node_id} does not answer", node=self.node_id) from error
            raise
        except SdoError:
            self._silences = 0
            raise
        self._silences = 0
        return data


@asynccontextmanager
async def _reading(bus: Bus, node_id: int, timing: Timing) -> AsyncGenerator[_Reader]:
    client = SdoClient(node_id, bus.send, timing)
    answers = cob.sdo_response(node_id)

    def on_frames(frames: Sequence[Frame]) -> None:
        for frame in frames:
            if frame.cob_id == answers and not (frame.error or frame.extended or frame.remote):
                client.on_frame(frame)

    end = bus.subscribe(on_frames)
    try:
        yield _Reader(client, node_id)
    finally:
        end()
        client.close()


async def _profile(reader: _Reader, catalog: Catalog) -> DeviceProfile:
    try:
        vendor, product = [
            int.from_bytes(await reader.read(address), "little") for address in (VENDOR, PRODUCT)
        ]
    except SdoTimeout as error:
        raise NodeAway(f"node {reader.node_id} does not answer", node=reader.node_id) from error
    profile = catalog.identify(vendor, product)
    if profile is None:
        raise WrongIdentity(
            f"node {reader.node_id} has vendor {vendor:X}h and product {product:X}h, which is no known model",
            hint=f"Name the model that it should be: {', '.join(catalog.models)}.",
            node=reader.node_id,
        )
    return profile


async def _compare_all(
    reader: _Reader, profile: DeviceProfile, progress: Callable[[int, int], None] | None
) -> list[Difference]:
    found: list[Difference] = []
    for done, spec in enumerate(profile.objects.values(), start=1):
        difference = await _compare_one(reader, spec)
        if difference is not None:
            found.append(Difference(spec.address, _name(spec), *difference))
        if progress is not None:
            progress(done, len(profile.objects))
    return found


_Finding = tuple[DifferenceKind, str, str]


async def _compare_one(reader: _Reader, spec: ObjectSpec) -> _Finding | None:
    try:
        data = await reader.read(spec.address)
    except SdoAborted as refused:
        if refused.abort_code in _MISSING:
            return DifferenceKind.MISSING, _type(spec.type), refused.meaning
        return (DifferenceKind.ACCESS, str(spec.access), refused.meaning) if spec.access.readable else None
    except SdoError as error:
        return DifferenceKind.NO_ANSWER, _type(spec.type), error.message
    if not spec.access.readable:
        return DifferenceKind.ACCESS, str(spec.access), "it can be read"
    try:
        value = decode(spec.type, data)
    except CodecError:
        return DifferenceKind.LENGTH, _type(spec.type), f"{_bytes(len(data))} ({data.hex(' ')})"
    return _compare_value(spec, value, reader.node_id)


def _compare_value(spec: ObjectSpec, value: Value, node_id: int) -> _Finding | None:
    default = spec.default_for(node_id)
    if default is not None and value != default and _is_fixed(spec):
        return DifferenceKind.CONSTANT, _shown(default, spec), _shown(value, spec)
    if spec.check(value) is not None:
        return DifferenceKind.RANGE, _allowed(spec), _shown(value, spec)
    if default is not None and value != default and spec.access.writable:
        return DifferenceKind.SETTING, _shown(default, spec), _shown(value, spec)
    return None


def _is_fixed(spec: ObjectSpec) -> bool:
    """Whether what it holds can't change while the module lives.

    Of what can't be written these are the communication objects but for the error register, the numbers of
    entries, what the drive profile says of the axis, and what has one possible value.
    """
    if spec.access.writable:
        return False
    counts = spec.sub == 0 and spec.kind is not ObjectKind.VAR
    communication = spec.index < 0x2000 and spec.index != _ERROR_REGISTER
    single = spec.low is not None and spec.low == spec.high
    return counts or communication or single or spec.base_index in _FIXED_IN_PROFILE


def _name(spec: ObjectSpec) -> str:
    name = spec.name if spec.kind is ObjectKind.VAR else f"{spec.object_name}: {spec.name}"
    return name if spec.axis is None else f"{name} (axis {spec.axis})"


def _type(data_type: DataType) -> str:
    size = data_type.size
    return data_type.short if size is None else f"{_bytes(size)} ({data_type.short})"


def _bytes(count: int) -> str:
    return f"{count} byte{'' if count == 1 else 's'}"


def _allowed(spec: ObjectSpec) -> str:
    if spec.allowed is not None:
        return "one of " + ", ".join(map(str, sorted(spec.allowed)))
    return f"{spec.minimum} to {spec.maximum}"


def _shown(value: Value, spec: ObjectSpec) -> str:
    if isinstance(value, int) and spec.index < _PROFILE_AREA and not spec.type.signed and value > 9:
        return f"{value} ({value:X}h)"
    return repr(value) if isinstance(value, str) else str(value)
