"""One tree of settings, and what it comes to for the master and the bus; `loading` reads it.

The bus speaks python-can's own vocabulary (`interface`, `channel`, `bitrate`, and whatever else its interface
takes under `options`). Lengths, speeds and accelerations of an axis are in the axis's own `unit` or name
theirs (`app.configuration.axes`). A key that isn't known is an error that names the key.
"""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated, Any, Self

from platformdirs import user_state_path
from pydantic import Field, SecretStr, field_validator, model_validator

from app.configuration.axes import AxisSettings
from app.configuration.sections import ConfigurationError, Name, Section
from drivers.errors import BadValue
from drivers.master.plan.configuration import NetworkConfig, NodeConfig

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

TOKEN_LENGTH = 22
"""Characters of a token: 128 random bits in base64; in hexadecimal they are 32."""
TOKEN_VARIETY = 8
"""Different characters that a random token surely has, unlike most made up."""


class BusConfiguration(Section):
    """Which wire to open, in python-can's words."""

    interface: str = "socketcand"
    channel: str | None = "can0"
    bitrate: int | None = Field(default=None, gt=0, le=1_000_000, description="bit/s")
    options: dict[str, Any] = Field(default_factory=dict, description="Further options of the interface.")

    def arguments(self) -> dict[str, Any]:
        """What `PythonCanBus` takes."""
        return {
            "interface": self.interface,
            "channel": self.channel,
            "bitrate": self.bitrate,
            **self.options,
        }


class ServerConfiguration(Section):
    """Where the service listens, and who may speak to it."""

    host: str = "127.0.0.1"
    port: int = Field(default=8402, ge=0, le=65535, description="0 lets the system choose.")
    token: SecretStr | None = Field(
        default=None, description="A bearer token for everything; random, 22 characters or more."
    )
    token_file: Path | None = Field(
        default=None, description="File of hashed tokens with names and roles, made by `canaxis token`."
    )
    allowed_hosts: tuple[str, ...] = Field(default=(), description="Further values of the Host header.")
    allowed_origins: tuple[str, ...] = Field(default=(), description="Origins of web pages that may command.")
    max_streams: int = Field(
        default=64, ge=1, description="Event streams open at once, and connections that jog."
    )
    jog_silence_ms: int = Field(
        default=500, ge=200, le=2000, description="Without a hold for so long, a jogged axis is stopped."
    )
    max_connections: int = Field(default=512, ge=8, description="TCP connections open at once.")
    requests_per_second: Positive | None = Field(
        default=5000.0, description="Of one client address, stops excepted; null: no limit."
    )
    request_timeout: Positive = Field(
        default=10.0, description="Seconds in which the head of a request must be here, and its body."
    )
    stop_timeout: Positive = Field(default=5.0, description="Seconds that open requests get at shutdown.")

    @field_validator("token")
    @classmethod
    def _check_token(cls, token: SecretStr | None) -> SecretStr | None:
        text = "" if token is None else token.get_secret_value()
        long_enough = len(text) >= TOKEN_LENGTH and len(set(text)) >= TOKEN_VARIETY
        if token is not None and not (
            long_enough and text.isascii() and text.isprintable() and " " not in text
        ):
            raise ValueError(
                f"at least {TOKEN_LENGTH} random ASCII characters without spaces are needed; "
                "`openssl rand -hex 16` makes some"
            )
        return token

    @property
    def has_token(self) -> bool:
        """Whether requests need a token."""
        return self.token is not None or self.token_file is not None

    @property
    def is_loopback(self) -> bool:
        """Whether only programs on this machine can reach us."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"  # any other name may lead anywhere


class TrajectoryConfiguration(Section):
    """Paths that are sent as points."""

    max_bytes: int = Field(default=256 << 20, ge=1024, description="The largest body, as JSON or CSV.")
    upload_timeout: Positive = Field(
        default=600.0, description="Seconds in which it must be here; see also server.request_timeout."
    )
    folder: Path | None = Field(
        default=None, description="Where points are put aside; none: the system's for temporary files."
    )


class ObjectsConfiguration(Section):
    """Raw access to the object dictionary."""

    writable: bool = Field(default=False, description="Whether PUT on objects is allowed at all.")


def default_store() -> Path:
    """Where `canaxis serve` remembers operations if no file is named: the user's folder for state."""
    return user_state_path("canaxis") / "canaxis.db"


class StoreConfiguration(Section):
    """Where operations are remembered, and how long."""

    file: Path | None = Field(
        default=None, description="SQLite file; without one, everything is forgotten when the service ends."
    )
    keep_days: Positive = Field(default=90, description="Days for which ended operations are kept.")
    keep_operations: int = Field(default=100_000, ge=1, description="How many ended operations are kept.")


class AuditConfiguration(Section):
    """The record of who commanded what, besides the log."""

    file: Path | None = Field(default=None, description="JSON lines are added to it; none: the log alone.")
    max_bytes: int = Field(default=10_000_000, ge=10_000, description="A larger file is set aside.")
    keep: int = Field(default=5, ge=1, le=1000, description="Files that were set aside and are kept.")


class LogConfiguration(Section):
    """What is logged, and how."""

    level: str = Field(default="info", pattern="^(debug|info|warning|error)$")
    format: str = Field(default="console", pattern="^(console|json)$")


def _three_axes() -> tuple[AxisSettings, ...]:
    return tuple(AxisSettings(name=name) for name in ("x", "y", "z"))


class NodeSettings(Section):
    """One module on the bus."""

    id: int = Field(ge=1, le=127)
    name: Name
    model: str = "TMCM-3216"
    axes: tuple[AxisSettings, ...] = Field(default_factory=_three_axes, min_length=1)
    analog_full_scale: float | None = Field(
        default=None, gt=0, le=1000, description="Volts at which an analog input reads its highest value."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        names = [axis.name for axis in self.axes]
        if len(set(names)) != len(names):
            raise ValueError("axes: two axes have the same name")
        return self

    def to_config(self) -> NodeConfig:
        """What the master takes."""
        return NodeConfig(
            node_id=self.id,
            name=self.name,
            model=self.model,
            axes=tuple(axis.to_config() for axis in self.axes),
            analog_full_scale=self.analog_full_scale,
        )


def _one_node() -> tuple[NodeSettings, ...]:
    return (NodeSettings(id=1, name="stage"),)


class NetworkConfiguration(Section):
    """What the master itself is on the bus, and how who watches whom."""

    master_node_id: int | None = Field(default=None, ge=1, le=127)
    heartbeat_ms: int | None = Field(default=None, ge=10, le=1000)
    consumer_ms: int | None = Field(default=None, ge=50, le=10_000)
    node_heartbeat_ms: int | None = Field(default=None, ge=10, le=10_000)
    allow_unverified_failsafe: bool | None = None
    sender_process: bool | None = None


class Configuration(Section):
    """All of it."""

    bus: BusConfiguration = Field(default_factory=BusConfiguration)
    server: ServerConfiguration = Field(default_factory=ServerConfiguration)
    network: NetworkConfiguration = Field(default_factory=NetworkConfiguration)
    nodes: tuple[NodeSettings, ...] = Field(default_factory=_one_node, min_length=1)
    trajectories: TrajectoryConfiguration = Field(default_factory=TrajectoryConfiguration)
    objects: ObjectsConfiguration = Field(default_factory=ObjectsConfiguration)
    store: StoreConfiguration = Field(default_factory=StoreConfiguration)
    audit: AuditConfiguration = Field(default_factory=AuditConfiguration)
    log: LogConfiguration = Field(default_factory=LogConfiguration)

    @model_validator(mode="after")
    def _check(self) -> Self:
        ids = [node.id for node in self.nodes]
        names = [node.name for node in self.nodes]
        if len(set(ids)) != len(ids):
            raise ValueError("nodes: two nodes have the same id")
        if len(set(names)) != len(names):
            raise ValueError("nodes: two nodes have the same name")
        return self

    def with_store(self, file: Path) -> Configuration:
        """The same with this file for the store, unless one is named already."""
        if self.store.file is not None:
            return self
        return self.model_copy(update={"store": self.store.model_copy(update={"file": file})})

    def network_config(self) -> NetworkConfig:
        """What the master takes. Raises `ConfigurationError` for what it refuses."""
        given = self.network.model_dump(exclude_none=True)
        try:
            return NetworkConfig(nodes=tuple(node.to_config() for node in self.nodes), **given)
        except BadValue as error:
            raise ConfigurationError(error.message) from error

    def check_exposure(self) -> None:
        """Refuse an address that others can reach without a token. Raises `ConfigurationError`."""
        if not self.server.has_token and not self.server.is_loopback:
            raise ConfigurationError(
                f"server.host: {self.server.host} can be reached by others, and no token is set; "
                "set server.token or server.token_file, or listen on 127.0.0.1"
            )
