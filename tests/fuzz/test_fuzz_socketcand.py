"""The socketcand server against any bytes: each malformed command is told so, and the next client is served.

The texts of single commands: tests/drivers/bus/test_bus_socketcand_text.py.
"""

from __future__ import annotations

import asyncio

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.memory import MemoryWire
from drivers.sim.socketcand import SocketcandServer

COMMANDS = (
    *(
        b"< open can0 >",
        b"< open vcan7 >",
        b"< rawmode >",
        b"< bcmmode >",
        b"< echo >",
        b"<<>>",
        b"<",
        b">",
        b" ",
    ),
    *(b"< send 123 2 1 F1 >", b"< send 123 9 1 >", b"< send 1AAAAAAA 0 >", b"< sendrtr 123 0 >"),
    *(b"x" * 300, b"\0\xff"),
)
words = st.sampled_from(COMMANDS)
chunks = st.lists(words | st.binary(max_size=20), max_size=20)


@settings(max_examples=60)
@given(chunks)
def test_no_client_breaks_the_server_or_another_client(sent: list[bytes]) -> None:
    asyncio.run(serve(sent))


async def serve(sent: list[bytes]) -> None:
    server = SocketcandServer(MemoryWire(), port=0)
    await server.start()
    try:
        async with asyncio.timeout(20):
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            writer.writelines(sent)
            writer.write_eof()
            said = await reader.read()
            writer.close()
            assert said.startswith(b"< hi >")
            assert said.count(b"< error ") >= min(1, server.counters.malformed)
            assert server.counters.accepted == 1
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            writer.write(b"< open can0 >< rawmode >< echo >")
            assert await reader.readuntil(b"< echo >") == b"< hi >< ok >< ok >< echo >"
            writer.close()
            await writer.wait_closed()
    finally:
        await server.close()
    assert server.clients == 0
