"""Tokens, tickets, roles and rates: what each lets pass, and what it keeps."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.access.roles import Role, role_for
from app.access.tickets import CAPACITY, LIFETIME, Tickets
from app.access.tokens import Principal, Tokens, add_token, read_tokens
from app.cli import command_line
from app.configuration.configuration import ServerConfiguration
from app.configuration.sections import ConfigurationError
from app.http.rates import CLIENTS, RateLimit

READER = Principal("screen", Role.READ)


class Clock:
    """A clock that stands until it is moved."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_token_is_shown_once_and_only_its_hash_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    result = CliRunner().invoke(
        command_line(["token"]), ["token", "screen", "--role", "read", "--token-file", str(file)]
    )
    assert result.exit_code == 0, result.output
    secret = result.output.split()[0]
    assert len(secret) == 43, "32 random bytes in base64"
    assert re.fullmatch(r"screen read sha256:[0-9a-f]{64}\n", file.read_text())
    assert secret not in file.read_text()
    assert file.stat().st_mode & 0o777 == 0o600
    assert Tokens.of(ServerConfiguration(token_file=file)).holder_of(secret) == READER


def test_several_tokens_have_their_own_names_and_roles(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    secrets = {role: add_token(file, role.word, role) for role in Role}
    tokens = Tokens.of(ServerConfiguration(token_file=file))
    for role, secret in secrets.items():
        assert tokens.holder_of(secret) == Principal(role.word, role)
        assert tokens.holder_of(secret[:-1]) is None
    with pytest.raises(ConfigurationError, match="named move"):
        add_token(file, "move", Role.READ)
    assert len(read_tokens(file)) == 4


HASH = "sha256:" + "0" * 64


@pytest.mark.parametrize(
    "text",
    [
        "",
        "# nothing but this\n",
        "correct-horse-battery-staple\n",
        f"a root {HASH}\n",
        f"a move {HASH}0\n",
        f"a move {HASH} more\n",
        f"1a move {HASH}\n",
        f"a move {HASH}\na read {HASH}\n",
        "a move sha1:0000\n",
    ],
)
def test_a_token_file_that_is_none_is_refused_and_not_shown(tmp_path: Path, text: str) -> None:
    file = tmp_path / "tokens"
    file.write_text(text)
    file.chmod(0o600)
    with pytest.raises(ConfigurationError, match=r"server\.token_file: ") as caught:
        Tokens.of(ServerConfiguration(token_file=file))
    assert "horse" not in str(caught.value)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666])
def test_a_token_file_that_others_may_read_is_refused(tmp_path: Path, mode: int) -> None:
    file = tmp_path / "tokens"
    add_token(file, "a", Role.READ)
    file.chmod(mode)
    with pytest.raises(ConfigurationError, match="chmod 600"):
        read_tokens(file)
    with pytest.raises(ConfigurationError, match="chmod 600"):
        add_token(file, "b", Role.READ)


def test_a_ticket_is_good_once_and_soon() -> None:
    clock = Clock()
    tickets = Tickets(clock)
    first, second = tickets.issue(READER), tickets.issue(READER)
    assert tickets.redeem("x") is None
    assert tickets.redeem(first) == READER
    assert tickets.redeem(first) is None
    clock.now += LIFETIME
    assert tickets.redeem(second) is None


def test_unused_tickets_are_bounded() -> None:
    tickets = Tickets(Clock())
    oldest = tickets.issue(READER)
    newer = [tickets.issue(READER) for _ in range(CAPACITY)]
    assert tickets.redeem(oldest) is None
    assert all(tickets.redeem(ticket) for ticket in newer)


def test_a_client_that_asks_evenly_passes_and_one_that_floods_waits() -> None:
    clock = Clock()
    limit = RateLimit(100, clock)
    for _ in range(1000):
        assert limit.delay("even") == 0
        clock.now += 0.011
    passed = sum(limit.delay("flood") == 0 for _ in range(1000))
    assert 100 <= passed <= 102, "one second's worth at once"
    assert limit.delay("even") == 0
    wait = limit.delay("flood")
    assert 0 < wait <= 0.011
    clock.now += wait
    assert limit.delay("flood") == 0


def test_clients_are_forgotten_before_they_grow_without_bound() -> None:
    limit = RateLimit(1, Clock())
    for number in range(3 * CLIENTS):
        limit.delay(str(number))
    assert len(limit._dry) <= CLIENTS


@pytest.mark.parametrize(
    ("method", "path", "role"),
    [
        ("GET", "/api/v1/nodes", Role.READ),
        ("POST", "/api/v1/stop", Role.STOP),
        ("POST", "/api/v1/stop/reset", Role.MOVE),
        ("POST", "/api/v1/nodes/1/axes/x/quick-stop", Role.STOP),
        ("POST", "/api/v1/nodes/1/axes/x/move", Role.MOVE),
        ("POST", "/api/v1/nodes/1/axes/x/move/", Role.CONFIGURE),
        ("DELETE", "/api/v1/nodes/1/axes/x/stop", Role.CONFIGURE),
        ("PUT", "/api/v1/nodes/1/objects/0x6081/0", Role.CONFIGURE),
        ("POST", "/api/v1/not-yet-thought-of", Role.CONFIGURE),
        ("WEBSOCKET", "/api/v1/not-yet-thought-of", Role.CONFIGURE),
    ],
)
def test_what_the_table_does_not_name_needs_the_highest_role(method: str, path: str, role: Role) -> None:
    assert role_for(method, path) is role
