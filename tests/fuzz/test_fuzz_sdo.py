"""An SDO transfer that is fed anything: what it ignores leaves no trace, and what it calls done is done.

That no frame breaks a client or a server, and all round trips: test_property_cia301_sdo.py.
"""

from __future__ import annotations

import copy

from hypothesis import example, given
from hypothesis import strategies as st

from drivers.cia301.objects import Address
from drivers.cia301.sdo import Aborted, Done, Ignored, SdoDownload, SdoServer, SdoUpload, Send, Violation

OURS = Address(0x2345, 6)
_ADDRESS = b"\x45\x23\x06"

answers = st.one_of(
    st.binary(max_size=9),
    st.builds(
        lambda command, data: bytes((command,)) + _ADDRESS + data,
        st.sampled_from((0x40, 0x41, 0x42, 0x43, 0x47, 0x4B, 0x4F, 0x60, 0x80)) | st.integers(0, 255),
        st.sampled_from((bytes(4), b"\x08\0\0\0", b"\x0e\0\0\0", b"\xff\xff\xff\xff"))
        | st.binary(min_size=4, max_size=4),
    ),
    st.builds(
        lambda command, data: bytes((command,)) + data,
        st.sampled_from((0x00, 0x01, 0x10, 0x11, 0x0D, 0x1D, 0x20, 0x30)),
        st.binary(min_size=7, max_size=7),
    ),
)


@given(st.booleans(), st.binary(max_size=30), st.lists(answers, max_size=20))
@example(True, b"", [b"\x81\x45\x23\x06\0\0\x02\x06"])
@example(True, b"", [b"\x41\x45\x23\x06\x08\0\0\0", b"\x00" + bytes(7), b"\x1d" + bytes(7)])
def test_what_is_ignored_leaves_no_trace_and_what_is_over_stays_over(
    upload: bool, payload: bytes, received: list[bytes]
) -> None:
    transfer = SdoUpload(OURS, max_size=40) if upload else SdoDownload(OURS, payload)
    sent = [transfer.request()]
    for data in received:
        before = copy.deepcopy(vars(transfer))
        match transfer.feed(data):
            case Ignored(reason):
                assert reason
                assert vars(transfer) == before
            case Send(request):
                assert not transfer.finished
                sent.append(request)
            case Done():
                assert transfer.finished
                assert upload or carried(sent) == payload
            case Violation(reason, abort):
                assert transfer.finished
                assert reason
                assert abort[:4] == b"\x80" + _ADDRESS
            case Aborted(code):
                assert transfer.finished
                assert (data[0] >> 5, data[1:4]) == (4, _ADDRESS)  # the other bits are reserved
                assert code == int.from_bytes(data[4:], "little")


def carried(requests: list[bytes]) -> bytes:
    """The payload in a client's requests, read as the standard has it (CiA 301 7.2.4.3)."""
    first, *segments = requests
    if first[0] & 0x02:
        return first[4 : 8 - (first[0] >> 2 & 3)]
    return b"".join(segment[1 : 8 - (segment[0] >> 1 & 7)] for segment in segments)


requests = st.one_of(
    st.binary(max_size=9),
    st.builds(
        lambda command, address, data: bytes((command,)) + address + data,
        st.sampled_from((0x20, 0x21, 0x22, 0x23, 0x2F, 0x40, 0x80, 0xA0, 0xC0)),
        st.sampled_from((_ADDRESS, b"\x46\x23\x00")),
        st.sampled_from((bytes(4), b"\x09\0\0\0", b"\xff\xff\xff\xff")) | st.binary(min_size=4, max_size=4),
    ),
    st.builds(
        lambda command, data: bytes((command,)) + data,
        st.sampled_from((0x00, 0x01, 0x10, 0x11, 0x0D, 0x1D, 0x60, 0x70)),
        st.binary(min_size=7, max_size=7),
    ),
)


@given(st.lists(requests, max_size=30), st.binary(min_size=1, max_size=30))
def test_a_server_writes_only_what_it_was_sent_and_serves_the_next_client(
    received: list[bytes], value: bytes
) -> None:
    held: dict[Address, bytes] = {}
    writes: list[bytes] = []

    def write(address: Address, data: bytes) -> None:
        writes.append(data)
        held[address] = data

    server = SdoServer(lambda address: held.get(address, b""), write)
    for number, data in enumerate(received, 1):
        answer = server.feed(data)
        assert answer is None or len(answer) == 8
        assert len(writes) <= number
        everything = b"".join(received[:number])
        assert all(len(written) <= len(everything) for written in writes)
    for transfer, wanted in ((SdoDownload(OURS, value), b""), (SdoUpload(OURS), value)):
        step = Send(transfer.request())
        while isinstance(step, Send):
            answer = server.feed(step.data)
            assert answer is not None
            step = transfer.feed(answer)
        assert step == Done(wanted)
