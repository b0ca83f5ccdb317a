"""Whatever comes over the wire, at whatever times: the module never raises, and what it sends are frames."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from sim_core_kit import profile

from drivers.bus.frame import Frame
from drivers.cia301.nmt import NmtState
from drivers.sim.module import SimulatedModule

IDENTIFIERS = (0x000, 0x080, 0x201, 0x301, 0x401, 0x501, 0x601, 0x77F, 0x7E5)
OBJECTS = sorted(profile().objects)

nmt = st.builds(
    lambda command, node: Frame(0, bytes((command, node))),
    st.sampled_from((1, 1, 1, 2, 0x80, 0x81, 0x82)),
    st.sampled_from((0, 1)),
)
noise = st.builds(Frame, st.sampled_from(IDENTIFIERS), st.binary(max_size=8))
write = st.builds(
    lambda address, data: Frame(
        0x601,
        bytes((0x23 | (4 - len(data)) << 2,))
        + address.index.to_bytes(2, "little")
        + bytes((address.sub,))
        + data.ljust(4, b"\0"),
    ),
    st.sampled_from(OBJECTS),
    st.one_of(st.binary(min_size=1, max_size=4), st.sampled_from((b"\x0f\0", b"\x1f\0", b"\x06\0", b"\x03"))),
)
steps = st.lists(st.tuples(st.one_of(nmt, noise, write), st.floats(0, 2)), max_size=60)


@given(steps)
def test_no_frame_and_no_time_breaks_it(steps: list[tuple[Frame, float]]) -> None:
    module = SimulatedModule(profile())
    now = 0.0
    sent = module.power_on(now)
    for frame, pause in steps:
        sent += module.on_frame(frame, now)
        end = now + pause
        for _ in range(200):
            due = module.next_wakeup(now)
            if due is None or due > end:
                break
            assert due >= now
            now = due
            sent += module.on_time(now)
        now = max(now, end)
    for frame in sent:
        assert 0 <= frame.cob_id <= 0x7FF
        assert len(frame.data) <= 8
    assert module.nmt_state in NmtState
