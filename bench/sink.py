"""A socketcand server that takes everything and says nothing: `python -m bench.sink` prints its port.

What the sender of set points sends has to go somewhere, at no cost to what is measured.
"""

from __future__ import annotations

import socket
import threading


def _serve(client: socket.socket) -> None:
    with client:
        client.sendall(b"< hi >")
        while said := client.recv(65_536):
            if b"open" in said or b"rawmode" in said:
                client.sendall(b"< ok >")


def _main() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        while True:
            client, _ = server.accept()
            threading.Thread(target=_serve, args=(client,), daemon=True).start()


if __name__ == "__main__":
    _main()
