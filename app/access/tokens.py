"""Tokens: who may speak to the service, by a secret that only its holder knows.

The service keeps their SHA-256 hashes alone. They are random and of 128 bits or more, so that no salt and no
slow hash is needed. A token file has one token in each line: its name, its role and its hash.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import re
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from app.access.roles import ROLES, Role
from app.configuration.configuration import ServerConfiguration
from app.configuration.sections import ConfigurationError

RANDOM_BYTES = 32
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,62}")
_HASH = re.compile(r"sha256:([0-9a-f]{64})")


@dataclass(frozen=True, slots=True)
class Principal:
    """Who sent a request, and what they may do."""

    name: str
    role: Role


LOCAL = Principal("anonymous", Role.CONFIGURE)
"""Whoever asks where no token is set: a program on this machine."""


@dataclass(frozen=True, slots=True)
class Token:
    """A token as the service knows it."""

    holder: Principal
    sha256: bytes


class Tokens:
    """All tokens of the service; with none of them, everybody who reaches it is `LOCAL`."""

    def __init__(self, tokens: Iterable[Token] = ()) -> None:
        self._tokens = tuple(tokens)

    @classmethod
    def of(cls, server: ServerConfiguration) -> Tokens:
        """Those of the token file, and the one in the settings. Raises `ConfigurationError`."""
        tokens: list[Token] = []
        if server.token_file is not None:
            tokens += read_tokens(server.token_file)
            if not tokens:
                raise ConfigurationError(
                    f"server.token_file: {server.token_file} holds no token; make one with `canaxis token`"
                )
        if server.token is not None:
            secret = server.token.get_secret_value()
            tokens.append(Token(Principal("settings", Role.CONFIGURE), hash_of(secret)))
        return cls(tokens)

    def __bool__(self) -> bool:
        return bool(self._tokens)

    def holder_of(self, secret: str) -> Principal | None:
        """Whose token it is, if it is one. Takes as long for a wrong one as for a right one."""
        given = hash_of(secret)
        found = None
        for token in self._tokens:
            if hmac.compare_digest(given, token.sha256):
                found = token.holder
        return found


def hash_of(secret: str) -> bytes:
    """What is kept of a secret."""
    return hashlib.sha256(secret.encode("utf-8", "replace")).digest()


def read_tokens(path: Path) -> tuple[Token, ...]:
    """The tokens of a file. Raises `ConfigurationError` with the line that is wrong, not what it holds."""
    try:
        if path.stat().st_mode & 0o077:
            raise ConfigurationError(
                f"server.token_file: {path} must be readable by its owner only (chmod 600)"
            )
        text = path.read_text(encoding="ascii")
    except OSError as error:
        raise ConfigurationError(f"server.token_file: {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"server.token_file: {path} is no ASCII text") from error
    tokens: dict[str, Token] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        token = _parse(line)
        if token is None:
            raise ConfigurationError(
                f"server.token_file: {path}, line {number}: a name, a role ({', '.join(ROLES)}) and "
                "sha256:HASH are expected; `canaxis token` writes such lines"
            )
        if token.holder.name in tokens:
            raise ConfigurationError(
                f"server.token_file: {path}, line {number}: {token.holder.name} is there twice"
            )
        tokens[token.holder.name] = token
    return tuple(tokens.values())


def _parse(line: str) -> Token | None:
    match line.split():
        case [name, role, hashed] if _NAME.fullmatch(name) and role in ROLES:
            found = _HASH.fullmatch(hashed)
            return None if found is None else Token(Principal(name, ROLES[role]), bytes.fromhex(found[1]))
        case _:
            return None


def add_token(path: Path, name: str, role: Role) -> str:
    """Make a token and add its hash to a file, which is made (mode 0600) if it isn't there.

    Returns the token, which nobody can read again. Raises `ConfigurationError`.
    """
    if _NAME.fullmatch(name) is None:
        raise ConfigurationError(
            f"{name[:80]!r} is no name for a token: letters, digits, _ . and - are, a letter first"
        )
    if path.exists() and any(token.holder.name == name for token in read_tokens(path)):
        raise ConfigurationError(
            f"{path} has a token named {name}; remove its line first, or choose another name"
        )
    secret = secrets.token_urlsafe(RANDOM_BYTES)
    try:
        with open(path, "a", encoding="ascii", opener=private) as file:
            file.write(f"{name} {role.word} sha256:{hash_of(secret).hex()}\n")
    except OSError as error:
        raise ConfigurationError(f"{path}: {error.strerror}") from error
    return secret


def private(path: str, flags: int) -> int:
    """An opener for `open` that makes files which their owner alone can read."""
    return os.open(path, flags, 0o600)
