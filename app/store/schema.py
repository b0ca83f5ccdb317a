"""The tables of the store, as numbered migrations: a file of any earlier version is brought up step by step.

A migration that was released is never changed; what is to be different is a new one at the end.
"""

from __future__ import annotations

OPERATIONS = """
CREATE TABLE operations (
    id TEXT PRIMARY KEY,
    created REAL NOT NULL,
    ended REAL,
    state TEXT NOT NULL,
    key TEXT,
    document TEXT NOT NULL
);
CREATE INDEX operations_by_creation ON operations (created, id);
CREATE INDEX operations_unended ON operations (id) WHERE ended IS NULL;
CREATE INDEX operations_by_key ON operations (key) WHERE key IS NOT NULL;
"""
"""`created` and `ended` are seconds since 1970; `document` is the operation as the API shows it (JSON)."""

KEYS = """
CREATE TABLE keys (
    key TEXT PRIMARY KEY,
    born REAL NOT NULL,
    fingerprint BLOB NOT NULL,
    status INTEGER,
    headers TEXT,
    body BLOB
);
CREATE INDEX keys_by_birth ON keys (born);
"""
"""Idempotency keys; `status` is NULL until the first request with the key was answered."""

POSITIONS = """
CREATE TABLE positions (
    node INTEGER NOT NULL,
    axis INTEGER NOT NULL,
    name TEXT NOT NULL,
    steps INTEGER NOT NULL,
    unit TEXT NOT NULL,
    needs_reference INTEGER NOT NULL,
    taught REAL NOT NULL,
    taught_by TEXT NOT NULL,
    PRIMARY KEY (node, axis, name)
) WITHOUT ROWID;
"""
"""Named positions; `taught` is seconds since 1970."""

SETTINGS = """
CREATE TABLE settings (
    revision INTEGER PRIMARY KEY,
    created REAL NOT NULL,
    who TEXT NOT NULL,
    address TEXT NOT NULL,
    what TEXT NOT NULL,
    document TEXT NOT NULL
);
"""
"""Revisions of what was set at run time; `document` is all of it (JSON): for each axis what goes over the
settings file.
"""

COUNTERS = """
CREATE TABLE counters (
    name TEXT PRIMARY KEY,
    value INTEGER NOT NULL
);
"""
"""Numbers that only rise: the fencing token of the last lease."""

MIGRATIONS: tuple[str, ...] = (OPERATIONS, KEYS, POSITIONS, SETTINGS, COUNTERS)
"""The schema's version is how many of them were applied (PRAGMA user_version)."""
