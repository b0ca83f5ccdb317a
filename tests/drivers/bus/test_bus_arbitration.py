from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.frame import Frame
from drivers.bus.memory import arbitration_key, frame_bits

standard = st.builds(Frame, st.integers(0, 0x7FF), remote=st.booleans())
extended = st.builds(Frame, st.integers(0, 0x1FFFFFFF), remote=st.booleans(), extended=st.just(True))


def field(frame: Frame) -> str:
    """The arbitration field bit by bit as it goes over the wire, a dominant 0 before a recessive 1."""
    if frame.extended:
        return f"{frame.cob_id >> 18:011b}11{frame.cob_id & 0x3FFFF:018b}{frame.remote:d}"
    return f"{frame.cob_id:011b}{frame.remote:d}0"


@given(standard | extended, standard | extended)
def test_the_key_orders_frames_as_the_bits_on_the_wire_do(one: Frame, other: Frame) -> None:
    assert (arbitration_key(one) < arbitration_key(other)) == (field(one) < field(other))


def test_frames_take_the_bits_of_the_standard() -> None:
    assert [frame_bits(Frame(1, bytes(size))) for size in (0, 6, 8)] == [47, 95, 111]
    assert frame_bits(Frame(1, bytes(8), extended=True)) == 131
