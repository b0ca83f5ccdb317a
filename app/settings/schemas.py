"""Settings on the wire."""

from __future__ import annotations

from datetime import datetime
from typing import Literal, Self

from pydantic import Field, model_validator

from app.axes.schemas import ChangeReply
from app.configuration.axes import AxisValues
from app.configuration.configuration import NodeSettings
from app.configuration.sections import Section
from app.http import examples
from app.http.schemas import Reply, Request

_WRITTEN: examples.Example = {
    "index": "0x6081",
    "sub": 0,
    "name": "Profile Velocity",
    "axis": 0,
    "old": 102400,
    "new": 128000,
    "unit": "steps/s",
}
_AXIS: examples.Example = {
    "node": 1,
    "axis": 0,
    "name": "x",
    "unit": "mm",
    "units": ["steps", "turns", "deg", "mm", "um"],
    "revision": 1,
    "durable": True,
    "problem": None,
    "settings": {
        "unit": "mm",
        "pitch": {"value": 5, "unit": "mm"},
        "velocity": {"value": 12.5, "unit": "mm/s"},
        "homing_method": 35,
    },
    "sources": {"unit": "file", "pitch": "file", "velocity": "revision", "homing_method": "default"},
    "objects": [
        {
            "setting": "velocity",
            "index": "0x6081",
            "sub": 0,
            "name": "Profile Velocity",
            "value": 128000,
            "unit": "steps/s",
            "needs_disable": False,
        }
    ],
    "written": [_WRITTEN],
}
_APPLIED: examples.Example = {
    "revision": 2,
    "durable": True,
    "axes": [{"node": 1, "axis": 0, "name": "x", "written": [_WRITTEN]}],
}


class AxisSettingsPatch(AxisValues):
    """What is to be different; null brings a setting back to its default. Every number has its unit."""

    model_config = examples.shown(
        {"velocity": {"value": 12.5, "unit": "mm/s"}, "run_current": {"value": 60, "unit": "%"}}
    )

    @model_validator(mode="after")
    def _check_that_units_are_named(self) -> Self:
        named = [*self.measures(), *([] if self.pitch is None else [("pitch", self.pitch)])]
        named += [("soft_limits", limit) for limit in self.soft_limits or ()]
        for key, measure in named:
            if measure.unit is None:
                raise ValueError(f'{key} must come with its unit, as {{"value": 1, "unit": "..."}}')
        return self


class HeldReply(Reply):
    """An object in which a setting is held."""

    setting: str
    index: str = Field(description="Hexadecimal.")
    sub: int
    name: str
    value: int
    unit: str = Field(description="Of `value`; empty for a plain number.")
    needs_disable: bool = Field(description="Whether it is written only while the axis is disabled.")


class AxisSettingsReply(Reply):
    """What an axis is set to, every number with its unit."""

    model_config = examples.shown(_AXIS)

    node: int
    axis: int
    name: str
    unit: str = Field(description="What positions are shown in.")
    units: list[str] = Field(description="What commands may be given in.")
    revision: int | None = Field(
        description="0: the settings file alone; None: what was kept isn't known, and nothing can be changed."
    )
    durable: bool = Field(description="Whether revisions outlive the service (`store.file`).")
    problem: str | None = Field(description="Why what was kept isn't gone by.")
    settings: AxisValues = Field(
        description="null: what follows from others, or what the module holds already, which isn't touched."
    )
    sources: dict[str, str] = Field(
        description="Where each value comes from: `revision` (set at run time), `file` (canaxis.yaml), "
        "`default`, or `module` (as it holds it)."
    )
    objects: list[HeldReply] = Field(description="What comes of it in the module.")
    written: list[ChangeReply] = Field(description="What this request wrote, each read back.")


class SettingsFile(Section):
    """Nodes and axes as `nodes` in canaxis.yaml; what an axis leaves out is at its default."""

    model_config = examples.shown(
        {"nodes": [{"id": 1, "name": "stage", "axes": [{"name": "x", "unit": "mm", "pitch": "5 mm"}]}]}
    )

    nodes: tuple[NodeSettings, ...]


class FieldDifference(Reply):
    """A setting that the document has otherwise than the service goes by."""

    node: int
    axis: int
    name: str
    setting: str
    kept: object = Field(description="What is gone by now; None: the default.")
    wanted: object = Field(description="What the document says; None: the default.")


class ObjectDifference(Reply):
    """An object that the module holds otherwise."""

    node: int
    axis: int
    name: str = Field(description="Of the axis.")
    setting: str
    index: str = Field(description="Hexadecimal.")
    sub: int
    object: str = Field(description="Name of the object.")
    wanted: int
    held: int | None = Field(description="Read just now; None: the module refuses to say.")
    unit: str
    needs_disable: bool = Field(description="Whether it is written only while the axis is disabled.")


class UnreadReply(Reply):
    """A node that could not be asked."""

    node: int
    reason: str


class DiffReply(Reply):
    """In what a document, the settings and the modules differ."""

    model_config = examples.shown({"equal": True, "fields": [], "objects": [], "compared": 90, "unread": []})

    equal: bool
    fields: list[FieldDifference]
    objects: list[ObjectDifference]
    compared: int = Field(description="Objects that were read.")
    unread: list[UnreadReply]


class AppliedAxis(Reply):
    """What was written to an axis's module, each read back."""

    node: int
    axis: int
    name: str
    written: list[ChangeReply]


class AppliedReply(Reply):
    """Settings that are gone by now."""

    model_config = examples.shown(_APPLIED)

    revision: int | None
    durable: bool = Field(description="Whether it outlives the service (`store.file`).")
    axes: list[AppliedAxis]


class RollbackBody(Request):
    """Which settings to go back to."""

    model_config = examples.shown({"revision": 0})

    revision: int = Field(ge=0, le=2**53, description="0: the settings file alone.")


class RevisionReply(Reply):
    """A change of settings."""

    revision: int
    created: datetime
    who: str
    address: str
    what: str = Field(description="patch, apply or rollback.")
    settings: dict[str, object] = Field(
        description="By node/axis: all that was set at run time, over the settings file; null: the default."
    )
    current: bool


class RevisionList(Reply):
    """Revisions, the newest first."""

    model_config = examples.shown(
        {
            "current": 1,
            "revisions": [
                {
                    "revision": 1,
                    "created": "2026-11-22T07:06:11.171528Z",
                    "who": "anonymous",
                    "address": "127.0.0.1",
                    "what": "patch",
                    "settings": {"1/0": {"velocity": {"value": 12.5, "unit": "mm/s"}}},
                    "current": True,
                }
            ],
        }
    )

    current: int | None
    revisions: list[RevisionReply]


class StoreBody(Request):
    """Which parameters of the module."""

    model_config = examples.shown({"what": "axis", "axis": "x", "confirm": True})

    what: Literal["all", "communication", "axis"]
    axis: str | None = Field(
        default=None, min_length=1, max_length=64, description="Number or name, with `axis`."
    )
    confirm: Literal[True] = Field(description="That it is meant.")


class StoreReply(Reply):
    """What was done to the module's memory."""

    model_config = examples.shown(
        {"node": 1, "what": "axis", "axis": 0, "note": "The module starts with what it holds now."}
    )

    node: int
    what: str
    axis: int | None
    note: str = Field(description="When it takes effect.")
