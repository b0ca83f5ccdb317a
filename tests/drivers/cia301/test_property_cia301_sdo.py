"""Our SDO client against our SDO server, on a channel where foreign frames turn up at any moment."""

from __future__ import annotations

from collections.abc import Iterator

from hypothesis import given
from hypothesis import strategies as st

from drivers.cia301.objects import Address
from drivers.cia301.sdo import (
    AbortCode,
    Aborted,
    Done,
    Ignored,
    SdoAbort,
    SdoDownload,
    SdoServer,
    SdoTransfer,
    SdoUpload,
    Send,
    Step,
    Violation,
)

OURS = Address(0x2345, 6)

payloads = st.binary(max_size=1000)
addresses = st.builds(Address, st.integers(0, 0xFFFF), st.integers(0, 0xFF))
frames = st.binary(max_size=9)


@st.composite
def foreign_frames(draw: st.DrawFn) -> bytes:
    """A frame that carries another object's address, or that is no SDO frame at all."""
    if draw(st.booleans()):
        return draw(st.binary(max_size=9).filter(lambda data: len(data) != 8))
    address = draw(addresses.filter(lambda other: other != OURS))
    command = draw(st.integers(0x40, 0xFF))  # below are segments, which carry no address
    return bytes((command,)) + address.index.to_bytes(2, "little") + bytes((address.sub,)) + bytes(4)


class OneObject:
    """A server that holds one object."""

    def __init__(self, value: bytes = b"") -> None:
        self.value = value
        self.writes = 0
        self.server = SdoServer(self._read, self._write)

    def _read(self, address: Address) -> bytes:
        if address != OURS:
            raise SdoAbort(AbortCode.NO_SUCH_OBJECT)
        return self.value

    def _write(self, address: Address, data: bytes) -> None:
        self._read(address)
        self.value = data
        self.writes += 1


def run(transfer: SdoTransfer, server: SdoServer, noise: Iterator[list[bytes]]) -> Step:
    """Carry the transfer to its end, feeding it noise before each answer."""
    request = transfer.request()
    for _ in range(200):
        for foreign in next(noise, []):
            assert isinstance(transfer.feed(foreign), Ignored), foreign.hex(" ")
        answer = server.feed(request)
        assert answer is not None
        assert len(answer) == len(request) == 8
        step = transfer.feed(answer)
        if not isinstance(step, Send):
            return step
        request = step.data
    raise AssertionError("the transfer does not end")


noises = st.lists(st.lists(foreign_frames(), max_size=3), max_size=20).map(iter)


@given(payloads, noises)
def test_any_payload_is_uploaded_past_foreign_frames(payload: bytes, noise: Iterator[list[bytes]]) -> None:
    assert run(SdoUpload(OURS), OneObject(payload).server, noise) == Done(payload)


@given(payloads, noises)
def test_any_payload_is_downloaded_past_foreign_frames(payload: bytes, noise: Iterator[list[bytes]]) -> None:
    node = OneObject(b"before")
    assert run(SdoDownload(OURS, payload), node.server, noise) == Done()
    assert (node.value, node.writes) == (payload, 1)


@given(payloads, addresses.filter(lambda other: other != OURS))
def test_a_refusal_reaches_the_client(payload: bytes, address: Address) -> None:
    node = OneObject()
    refused = Aborted(AbortCode.NO_SUCH_OBJECT)
    assert run(SdoUpload(address), node.server, iter([])) == refused
    assert run(SdoDownload(address, payload), node.server, iter([])) == refused
    assert node.writes == 0


@given(st.binary(min_size=5, max_size=200), st.integers(0, 28), st.booleans())
def test_a_wrong_toggle_anywhere_ends_the_transfer_with_05030000h(
    payload: bytes, wrong_at: int, upload: bool
) -> None:
    node = OneObject(payload if upload else b"before")
    transfer = SdoUpload(OURS) if upload else SdoDownload(OURS, payload)
    segments = -(-len(payload) // 7)
    wrong_at %= segments
    answer = node.server.feed(transfer.request())
    for segment in range(segments):
        assert answer is not None
        step = transfer.feed(answer)
        assert isinstance(step, Send)
        answer = node.server.feed(step.data)
        assert answer is not None
        if segment == wrong_at:
            step = transfer.feed(bytes((answer[0] ^ 0x10,)) + answer[1:])
            assert isinstance(step, Violation)
            assert step.abort == bytes.fromhex("80 45 23 06 00 00 03 05")
            return
    raise AssertionError("no wrong toggle was sent")


@given(st.booleans(), st.binary(max_size=20), st.lists(frames, max_size=30))
def test_no_frames_break_a_client(upload: bool, payload: bytes, received: list[bytes]) -> None:
    transfer = SdoUpload(OURS, max_size=40) if upload else SdoDownload(OURS, payload)
    for data in received:
        over = transfer.finished
        step = transfer.feed(data)
        assert not over or isinstance(step, Ignored)
        if isinstance(step, Send):
            assert len(step.data) == 8
        if isinstance(step, Done) and upload:
            assert len(step.data) <= 40


@given(st.lists(st.one_of(frames, st.binary(min_size=8, max_size=8)), max_size=40))
def test_no_frames_break_a_server(received: list[bytes]) -> None:
    node = OneObject(bytes(50))
    for data in received:
        answer = node.server.feed(data)
        assert answer is None or len(answer) == 8
    assert node.server.feed(b"\x40\x45\x23\x06" + bytes(4)) is not None


@given(st.binary(min_size=8, max_size=8))
def test_only_the_own_address_ends_a_transfer_at_its_first_answer(data: bytes) -> None:
    step = SdoUpload(OURS).feed(data)
    assert isinstance(step, Ignored) or data[1:4] == b"\x45\x23\x06"
