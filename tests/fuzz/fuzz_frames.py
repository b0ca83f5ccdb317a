"""What a hostile or broken wire may carry: frames of every kind, most of them near to meaningful ones."""

from __future__ import annotations

from collections.abc import Sequence

from hypothesis import strategies as st

from drivers.bus.frame import Frame
from drivers.cia301 import cob

payloads = st.binary(max_size=8)
_sdo_addresses = st.builds(
    lambda index, sub: index.to_bytes(2, "little") + bytes((sub,)),
    st.sampled_from((0x1000, 0x1001, 0x1008, 0x1017, 0x1018, 0x1029, 0x1400, 0x1600, 0x1A00, 0x6040, 0x6041))
    | st.sampled_from((0x6060, 0x607A, 0x6098, 0x60FF, 0x6840, 0x7040))
    | st.integers(0, 0xFFFF),
    st.integers(0, 4) | st.integers(0, 255),
)
_sdo_requests = st.builds(
    lambda command, address, data: bytes((command,)) + address + data,
    st.sampled_from((0x22, 0x23, 0x27, 0x2B, 0x2F, 0x21, 0x40, 0x60, 0x70, 0x00, 0x80, 0xA0, 0xC0))
    | st.integers(0, 255),
    _sdo_addresses,
    st.sampled_from(
        (b"\x0f\0\0\0", b"\x1f\0\0\0", b"\x06\0\0\0", b"\x07\0\0\0", b"\x80\0\0\0", b"\x03\0\0\0")
    )
    | st.binary(min_size=4, max_size=4),
)
_sdo_answers = st.builds(
    lambda command, address, data: bytes((command,)) + address + data,
    st.sampled_from((0x41, 0x43, 0x47, 0x4B, 0x4F, 0x42, 0x60, 0x20, 0x30, 0x00, 0x10, 0x80, 0xC0))
    | st.integers(0, 255),
    _sdo_addresses,
    st.binary(min_size=4, max_size=4),
)
_heartbeats = st.sampled_from((b"\x00", b"\x04", b"\x05", b"\x7f", b"\x85", b"\xff"))
_nmt = st.builds(
    lambda command, node: bytes((command, node)),
    st.sampled_from((0x01, 0x02, 0x80, 0x81, 0x82)) | st.integers(0, 255),
    st.sampled_from((0, 1)) | st.integers(0, 255),
)
_emergencies = st.builds(
    lambda code, register, detail, axis: (
        code.to_bytes(2, "little") + bytes((register, detail, axis, 0, 0, 0))
    ),
    st.sampled_from((0x0000, 0x8130, 0x8140, 0x8110, 0x2310, 0x4310, 0x5441, 0xFF00))
    | st.integers(0, 0xFFFF),
    st.integers(0, 255),
    st.integers(0, 8) | st.integers(0, 255),
    st.sampled_from((0, 1, 2, 255)) | st.integers(0, 255),
)
_statuswords = st.sampled_from(
    (0x0000, 0x0040, 0x0021, 0x0023, 0x0027, 0x0007, 0x000F, 0x0008, 0x1627, 0x1237, 0x0637, 0x4637)
) | st.integers(0, 0xFFFF)
_status_pdos = st.builds(
    lambda statusword, mode, inputs: statusword.to_bytes(2, "little") + bytes((mode,)) + inputs,
    _statuswords,
    st.sampled_from((0, 1, 3, 6)) | st.integers(0, 255),
    st.binary(min_size=4, max_size=5),
)
_words = st.builds(
    lambda word, rest: word.to_bytes(2, "little") + rest,
    st.sampled_from((0x00, 0x06, 0x07, 0x0F, 0x1F, 0x5F, 0x80, 0x10F, 0x02)) | st.integers(0, 0xFFFF),
    st.binary(max_size=6),
)
_NEAR: dict[cob.Service, st.SearchStrategy[bytes]] = {
    cob.Service.NMT: _nmt,
    cob.Service.EMCY: _emergencies,
    cob.Service.TPDO: _status_pdos,
    cob.Service.RPDO: _words,
    cob.Service.SDO_REQUEST: _sdo_requests,
    cob.Service.SDO_RESPONSE: _sdo_answers,
    cob.Service.HEARTBEAT: _heartbeats,
    cob.Service.SYNC: st.sampled_from((b"", b"\x00", b"\x01", b"\xf0")),
    cob.Service.LSS: st.builds(
        lambda command, rest: bytes((command,)) + rest,
        st.sampled_from((0x04, 0x11, 0x13, 0x17, 0x40, 0x41, 0x42, 0x43, 0x46, 0x4C, 0x51, 0x5E))
        | st.integers(0, 255),
        st.binary(min_size=7, max_size=7),
    ),
}
DAMAGES = ("none", "none", "none", "none", "bit", "short", "long")


@st.composite
def frames_near(draw: st.DrawFn, cob_ids: Sequence[int]) -> Frame:
    """Any frame; three in four carry one of these identifiers, and most a payload that nearly fits it."""
    cob_id = draw(st.sampled_from(cob_ids) if draw(st.integers(0, 3)) else st.integers(0, 0x7FF))
    kind = draw(st.sampled_from(("data",) * 13 + ("remote", "extended", "error")))
    if kind == "remote":
        return Frame(cob_id, remote=True)
    near = _NEAR.get(cob.classify(cob_id)[0])
    data = draw(payloads if near is None or not draw(st.integers(0, 3)) else near)
    match draw(st.sampled_from(DAMAGES)):
        case "bit" if data:
            at = draw(st.integers(0, 8 * len(data) - 1))
            data = (int.from_bytes(data, "little") ^ 1 << at).to_bytes(len(data), "little")
        case "short":
            data = data[: draw(st.integers(0, len(data)))]
        case "long":
            data = (data + bytes(8))[:8]
        case _:
            pass
    if kind == "extended":
        return Frame(cob_id | draw(st.sampled_from((0, 1 << 11, 1 << 28))), data, extended=True)
    return Frame(cob_id, data, error=kind == "error")
