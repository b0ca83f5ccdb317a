"""Any value of any type survives its bytes, and no bytes break a decoder."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cia301 import cob, heartbeat, lss, nmt, sync
from drivers.cia301.cob import PdoCobId
from drivers.cia301.emcy import Emergency
from drivers.cia301.lss_slave import LssSlave
from drivers.cia301.nmt import NmtCommand
from drivers.cia301.objects import MappedObject
from drivers.cia301.pdo import PdoLengthError, PdoMapping
from drivers.cia301.types import CodecError, DataType, Value, decode, encode

INTEGERS = [t for t in DataType if t.is_integer]
frames = st.binary(max_size=8)


def values_of(data_type: DataType) -> st.SearchStrategy[Value]:
    if data_type.is_integer:
        return st.integers(data_type.minimum, data_type.maximum)
    if data_type is DataType.BOOLEAN:
        return st.booleans()
    if data_type in (DataType.REAL32, DataType.REAL64):
        width = 32 if data_type is DataType.REAL32 else 64
        return st.floats(width=width, allow_nan=False, allow_infinity=False)
    if data_type is DataType.VISIBLE_STRING:
        return st.text(st.characters(min_codepoint=1, max_codepoint=255))
    if data_type is DataType.UNICODE_STRING:
        return st.text(st.characters(min_codepoint=1, exclude_categories=("Cs",)))
    return st.binary()


@pytest.mark.parametrize("data_type", list(DataType))
@given(data=st.data())
def test_any_value_of_any_type_survives(data_type: DataType, data: st.DataObject) -> None:
    value = data.draw(values_of(data_type))
    wire = encode(data_type, value)
    assert data_type.size in (None, len(wire))
    assert decode(data_type, wire) == value


@given(st.sampled_from(DataType), st.binary(max_size=12))
def test_bytes_are_decoded_or_refused_and_then_encode_to_themselves(data_type: DataType, wire: bytes) -> None:
    try:
        value = decode(data_type, wire)
    except CodecError:
        return
    if data_type.is_integer or data_type in (DataType.BOOLEAN, DataType.OCTET_STRING, DataType.DOMAIN):
        assert encode(data_type, value) == wire


@given(st.sampled_from(INTEGERS), st.integers(-(2**70), 2**70))
def test_an_integer_is_encoded_exactly_when_it_is_in_range(data_type: DataType, value: int) -> None:
    if data_type.minimum <= value <= data_type.maximum:
        assert len(encode(data_type, value)) == data_type.size
    else:
        with pytest.raises(CodecError):
            encode(data_type, value)


anything = st.one_of(
    st.none(), st.integers(), st.floats(), st.text(), st.binary(), st.booleans(), st.lists(st.integers())
)


@given(st.sampled_from(DataType), anything)
def test_whatever_is_given_encode_gives_bytes_or_a_codec_error(data_type: DataType, value: Value) -> None:
    try:
        wire = encode(data_type, value)
    except CodecError:
        return
    assert isinstance(wire, bytes)


@given(frames)
def test_no_frame_breaks_a_decoder(data: bytes) -> None:
    command = nmt.decode(data)
    assert command is None or nmt.encode(*command) == data
    state = heartbeat.decode(data)
    assert state is None or heartbeat.encode(state) == data
    emergency = Emergency.decode(data)
    assert (emergency is None) == (len(data) != 8)
    assert emergency is None or emergency.encode() == data
    beat = sync.decode(data)
    assert beat is None or sync.encode(beat.counter) == data
    lss.decode_answer(data)


@given(st.sampled_from(NmtCommand), st.integers(0, 127))
def test_any_nmt_command_survives(command: NmtCommand, node: int) -> None:
    assert nmt.decode(nmt.encode(command, node)) == (command, node)


@given(st.integers(1, 127), st.integers(0, 0xFFFF))
def test_any_consumer_entry_survives(node: int, time_ms: int) -> None:
    assert heartbeat.decode_consumer_entry(heartbeat.consumer_entry(node, time_ms)) == (node, time_ms)


@given(st.integers(0, (1 << 29) - 1), st.booleans(), st.booleans())
def test_any_pdo_cob_id_survives(cob_id: int, valid: bool, rtr_allowed: bool) -> None:
    entry = PdoCobId(cob_id, valid, rtr_allowed)
    assert PdoCobId.decode(entry.encode()) == entry


@given(st.integers(0, 0xFFFFFFFF))
def test_any_pdo_cob_id_value_can_be_read(value: int) -> None:
    entry = PdoCobId.decode(value)
    assert PdoCobId.decode(entry.encode()) == entry


@given(st.integers(0, 0xFFFFFFFF))
def test_any_mapping_entry_survives(value: int) -> None:
    assert MappedObject.decode(value).encode() == value


@given(st.integers())
def test_any_identifier_is_classified(cob_id: int) -> None:
    service, node = cob.classify(cob_id)
    assert 0 <= node <= 127
    assert isinstance(service, cob.Service)


@given(st.integers(1, 127))
def test_every_service_of_every_node_is_classified_as_itself(node: int) -> None:
    assert cob.classify(cob.emcy(node)) == (cob.Service.EMCY, node)
    assert cob.classify(cob.heartbeat(node)) == (cob.Service.HEARTBEAT, node)
    assert cob.classify(cob.sdo_request(node)) == (cob.Service.SDO_REQUEST, node)
    assert cob.classify(cob.sdo_response(node)) == (cob.Service.SDO_RESPONSE, node)
    for number in (1, 2, 3, 4):
        assert cob.classify(cob.tpdo(number, node)) == (cob.Service.TPDO, node)
        assert cob.classify(cob.rpdo(number, node)) == (cob.Service.RPDO, node)


@st.composite
def mappings(draw: st.DrawFn) -> PdoMapping:
    types: list[DataType] = []
    for data_type in draw(st.lists(st.sampled_from(INTEGERS), max_size=8)):
        if sum(t.size or 0 for t in [*types, data_type]) <= 8:
            types.append(data_type)
    entries = tuple(MappedObject(0x6000 + n, n, t.bits or 0) for n, t in enumerate(types))
    return PdoMapping(entries, tuple(types))


@given(st.data(), mappings())
def test_any_values_survive_any_mapping(data: st.DataObject, mapping: PdoMapping) -> None:
    values = tuple(data.draw(st.integers(t.minimum, t.maximum)) for t in mapping.types)
    wire = mapping.pack(values)
    assert len(wire) == mapping.size <= 8
    assert mapping.unpack(wire) == values
    assert wire == b"".join(encode(t, v) for t, v in zip(mapping.types, values, strict=True))


@given(mappings(), frames)
def test_any_frame_is_unpacked_or_has_another_length(mapping: PdoMapping, data: bytes) -> None:
    if len(data) != mapping.size:
        with pytest.raises(PdoLengthError):
            mapping.unpack(data)
    else:
        assert mapping.pack(mapping.unpack(data)) == data


lss_frames = st.one_of(
    frames,
    st.binary(min_size=8, max_size=8),
    st.builds(
        lambda command, rest: bytes((command,)) + rest,
        st.sampled_from(list(lss.Command)),
        st.binary(min_size=7, max_size=7),
    ),
)


@given(st.lists(lss_frames, max_size=30), st.sampled_from([1, 127, lss.UNCONFIGURED]))
def test_no_frames_break_an_lss_slave(received: list[bytes], node: int) -> None:
    slave = LssSlave(lss.Identity(0x286, 3216, 0x10004, 1), node=node)
    for data in received:
        answers, _ = slave.feed(data)
        assert all(lss.decode_answer(answer) is not None for answer in answers)
        assert slave.pending_node == lss.UNCONFIGURED or 1 <= slave.pending_node <= 127
        assert slave.pending_kbit_s in lss.BIT_RATE_INDEX
