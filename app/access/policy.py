"""What the middleware checks requests against: names, origins, tokens, bounds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from app.access.tokens import Tokens
from app.configuration.configuration import ServerConfiguration, TrajectoryConfiguration
from app.http.uploads import Uploads


@dataclass(frozen=True, slots=True)
class Policy:
    """What the middleware checks against."""

    hosts: frozenset[str]
    """Values of the Host header that are ours, in lower case."""
    origins: frozenset[str]
    """Origins of pages that may send requests, in lower case."""
    tokens: Tokens
    requests_per_second: float | None
    """Of one client, stops excepted; None: as many as it likes."""
    request_timeout: float
    """Seconds in which a body must be here."""
    uploads: Uploads
    """How the bodies of the few paths are taken that may be larger."""

    @classmethod
    def of(cls, server: ServerConfiguration, trajectories: TrajectoryConfiguration | None = None) -> Policy:
        """Loopback names with our port, the address that we listen on, and what the settings add.

        Raises `ConfigurationError` if the tokens can't be read.
        """
        trajectories = trajectories or TrajectoryConfiguration()
        port = server.port
        hosts = {f"127.0.0.1:{port}", f"localhost:{port}", f"[::1]:{port}"}
        if server.host not in ("0.0.0.0", "::"):
            hosts.add(f"[{server.host}]:{port}" if ":" in server.host else f"{server.host}:{port}")
        hosts |= set(_with_port(server.allowed_hosts, port))
        own = {f"http://{host}" for host in hosts} | {f"https://{host}" for host in hosts}
        return cls(
            hosts=frozenset(host.lower() for host in hosts),
            origins=frozenset(o.lower().rstrip("/") for o in own | set(server.allowed_origins)) - {"null"},
            tokens=Tokens.of(server),
            requests_per_second=server.requests_per_second,
            request_timeout=server.request_timeout,
            uploads=Uploads(
                max_bytes=trajectories.max_bytes,
                idle_timeout=server.request_timeout,
                total_timeout=trajectories.upload_timeout,
                folder=trajectories.folder,
            ),
        )


def _with_port(hosts: Iterable[str], port: int) -> Iterable[str]:
    """A host without a port stands for itself (behind a proxy on 80 or 443) and for itself with our port."""
    for host in hosts:
        yield host
        if ":" not in host.rpartition("]")[2]:
            yield f"{host}:{port}"
