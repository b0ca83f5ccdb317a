"""The axes' settings of now: those of the settings file, and over them what was set at run time.

What was set at run time is kept in the store as revisions. A change is written to the modules with read-back,
then kept, and only then gone by (`drivers.master.axis.reconfigure`); if any of that fails, the old settings
stay everywhere.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

import structlog
from pydantic import ValidationError

from app.access.schemas import Asker
from app.configuration.axes import AxisSettings
from app.configuration.configuration import Configuration
from app.configuration.sections import ConfigurationError
from app.http import validation
from app.http.problems import ApiError
from app.settings import table as records
from app.settings.table import Overlay, Revision
from app.store.database import Database, StoreOff
from drivers.errors import BadValue
from drivers.master.axis.axis import Axis
from drivers.master.axis.reconfigure import reconfigure
from drivers.master.network import Network
from drivers.master.plan.axis_parameters import check_ranges
from drivers.master.seen.boot_log import Change

MOST_REVISIONS = 1000
"""That are listed."""

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis.settings")


class SettingsBook:
    """All axes' settings, and the one way to change them."""

    def __init__(self, configuration: Configuration, network: Network, store: Database) -> None:
        self._store = store
        self._network = network
        self._file = {
            axis: _in_file(configuration, axis) for node in network.nodes.values() for axis in node.axes
        }
        self._overlays: dict[str, Overlay] = {}
        self._lock = asyncio.Lock()
        self.revision: int | None = None
        """What is gone by: 0 is the file alone; None while it isn't known what was kept."""
        self.problem: str | None = None
        """Why what was kept isn't gone by."""
        store.on_return.append(self._tidy_up)

    async def open(self) -> None:
        """Lay the newest revision over the settings file, before the network is opened."""
        try:
            found = await records.newest(self._store)
        except StoreOff as off:
            self.problem = f"What was set in earlier runs can't be read, so the settings file counts: {off}"
            log.warning("settings of earlier runs can't be read", reason=str(off))
            return
        if not found:
            self.revision = 0
            return
        revision = found[0]
        try:
            configs = {axis: self._settings(axis, revision.overlays) for axis in self._file}
            for axis, settings in configs.items():
                config = settings.to_config()
                check_ranges(config, axis.node.profile, axis.number)
                axis.go_by(config)
        except (ConfigurationError, ValidationError, BadValue) as error:
            for axis, settings in self._file.items():
                axis.go_by(settings.to_config())
            self.problem = (
                f"Revision {revision.number} doesn't fit the settings file, which counts alone: {error}"
            )
            log.error("kept settings don't fit the settings file", revision=revision.number, error=str(error))
            return
        self.revision, self._overlays = revision.number, dict(revision.overlays)
        changed = sorted(key for key, overlay in revision.overlays.items() if overlay)
        log.info("kept settings go over the settings file", revision=revision.number, axes=changed)

    # --- looking ---

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Every axis, in the order of the nodes."""
        return tuple(self._file)

    @property
    def durable(self) -> bool:
        """Whether what is set outlives the service."""
        return self._store.path is not None

    def settings(self, axis: Axis) -> AxisSettings:
        """What the axis is set to."""
        return self._settings(axis, self._overlays)

    def source(self, axis: Axis, setting: str) -> str:
        """Where a value comes from: ``revision``, ``file`` or ``default``."""
        overlay = self._overlays.get(_key(axis), {})
        if setting in overlay:
            return "default" if overlay[setting] is None else "revision"
        return "file" if setting in self._file[axis].explicit() else "default"

    def etag(self, axis: Axis) -> str:
        """Changes with the axis's settings."""
        text = json.dumps(self.settings(axis).explicit(), sort_keys=True)
        return f'"{hashlib.sha256(text.encode()).hexdigest()[:20]}"'

    async def revisions(self, limit: int) -> list[Revision]:
        """The newest first. Raises `ApiError` (503) while the store is off."""
        try:
            return await records.newest(self._store, limit)
        except StoreOff as off:
            raise ApiError("history_off", f"The revisions can't be read: {off}") from off

    # --- changing ---

    async def patch(
        self, axis: Axis, given: Mapping[str, Any], who: Asker, check: Callable[[], None]
    ) -> tuple[Change, ...]:
        """Change some settings of an axis; None brings one back to its default.

        `check` is called once nobody else changes anything. Returns what was written to the module. Raises
        what it raises, `ApiError` (422, 503), and what `reconfigure` raises.
        """
        async with self._lock:
            check()
            if "unit" in given and "steps_per_unit" not in given and self.settings(axis).steps_per_unit:
                raise ApiError(
                    "bad_value",
                    f"Axis {axis.name} has steps_per_unit, which counts steps in its unit: with another "
                    "unit it must be said anew.",
                    hint="Send steps_per_unit too, or null for it with a gearing.",
                )
            overlay = {**self._overlays.get(_key(axis), {}), **given}
            changes = await self._change({axis: overlay}, "patch", who)
        return changes[axis]

    async def apply(
        self, wanted: Mapping[Axis, AxisSettings], who: Asker
    ) -> Mapping[Axis, tuple[Change, ...]]:
        """Have these axes be set to just this, what is left out to its default. Raises as `patch`."""
        async with self._lock:
            return await self._change(
                {axis: self._overlay(axis, settings) for axis, settings in wanted.items()}, "apply", who
            )

    async def roll_back(self, number: int, who: Asker) -> Mapping[Axis, tuple[Change, ...]]:
        """Go by a revision's settings again, as a new revision; 0: by the settings file alone.

        Raises `ApiError` (404, 503) and as `patch`.
        """
        async with self._lock:
            overlays: Mapping[str, Overlay] = {}
            try:
                newest = await records.newest(self._store)
                if number:
                    found = await records.find(self._store, number)
                    if found is None:
                        raise ApiError("unknown_revision", f"There is no revision {number} of the settings.")
                    overlays = found.overlays
            except StoreOff as off:
                raise ApiError("history_off", f"The revisions can't be read: {off}") from off
            if self.revision is None:  # what was kept wasn't read at the start: it is known now
                self.revision = newest[0].number if newest else 0
            wanted = {
                axis: overlays.get(_key(axis), {})
                for axis in self._file
                if overlays.get(_key(axis), {}) != self._overlays.get(_key(axis), {})
            }
            return await self._change(wanted, "rollback", who)

    async def _change(
        self, overlays: Mapping[Axis, Overlay], what: str, who: Asker
    ) -> Mapping[Axis, tuple[Change, ...]]:
        if self.revision is None:
            raise ApiError(
                "history_off",
                f"{self.problem} Nothing is changed before it is known what was kept.",
                hint="Restart the service, or POST /api/v1/settings/rollback to a revision.",
            )
        if not self._store.health.on:
            raise ApiError(
                "history_off",
                f"Settings can't be kept now, so the old ones stay: {self._store.health.reason}",
            )
        everything = self._overlays | {_key(axis): overlay for axis, overlay in overlays.items()}
        try:
            configs = {axis: self._settings(axis, everything).to_config() for axis in overlays}
        except ConfigurationError as error:
            raise ApiError("bad_value", str(error)) from error
        except ValidationError as error:
            reply = validation.of_validation(
                [{**item, "loc": ("body", *item["loc"])} for item in error.errors()]
            )
            raise ApiError("bad_value", str(reply.body["detail"]), errors=reply.body.get("errors")) from error
        revision = Revision(self.revision + 1, datetime.now(UTC), who.name, who.address, what, everything)

        async def keep() -> None:
            if not await self._store.commit(records.written(revision)):
                raise ApiError(
                    "history_off",
                    f"The settings could not be kept, so the old ones stay: {self._store.health.reason}",
                )

        changes = await reconfigure(configs, keep)
        self._overlays, self.revision, self.problem = everything, revision.number, None
        log.info(
            "settings changed",
            revision=revision.number,
            what=what,
            who=who.name,
            axes=[a.name for a in configs],
        )
        return changes

    def _tidy_up(self) -> None:
        """The store works again: a revision that was given up on must not come back at the next start."""
        if self.revision is not None:
            self._store.later(records.trimmed(self.revision))

    def _overlay(self, axis: Axis, settings: AxisSettings) -> Overlay:
        """What must go over the file so that just `settings` comes of it."""
        wanted, there = settings.explicit(), self._file[axis].explicit()
        changed = {key: value for key, value in wanted.items() if there.get(key) != value}
        return changed | {key: None for key in there if key not in wanted}

    def _settings(self, axis: Axis, overlays: Mapping[str, Overlay]) -> AxisSettings:
        """Raises `ValidationError`."""
        there = self._file[axis]
        merged = {**there.explicit(), **overlays.get(_key(axis), {})}
        given = {key: value for key, value in merged.items() if value is not None}
        return AxisSettings.model_validate({"name": there.name, **given})


def _key(axis: Axis) -> str:
    return f"{axis.node.node_id}/{axis.number}"


def _in_file(configuration: Configuration, axis: Axis) -> AxisSettings:
    """What the settings file says of an axis; one that it leaves out has all defaults."""
    for node in configuration.nodes:
        if node.id == axis.node.node_id and axis.number < len(node.axes):
            return node.axes[axis.number]
    return AxisSettings(name=axis.name)
