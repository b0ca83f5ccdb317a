"""From the book of settings to the wire, and documents against it and against the modules."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

from starlette.responses import Response

from app.axes.views import change
from app.configuration.axes import AxisSettings, AxisValues
from app.configuration.measures import DIMENSIONS, unit_of, units_of, write_gear
from app.configuration.sections import ConfigurationError
from app.http.problems import ApiError
from app.settings.book import SettingsBook
from app.settings.schemas import (
    AppliedAxis,
    AppliedReply,
    AxisSettingsReply,
    DiffReply,
    FieldDifference,
    HeldReply,
    ObjectDifference,
    RevisionList,
    RevisionReply,
    SettingsFile,
    UnreadReply,
)
from app.settings.table import Revision
from drivers.errors import CanaxisError, SdoAborted
from drivers.master.axis.axis import Axis
from drivers.master.network import Network
from drivers.master.plan.axis_fields import SETTINGS
from drivers.master.plan.axis_parameters import check_ranges
from drivers.master.plan.axis_parameters import wanted as wanted_objects
from drivers.master.plan.configuration import AxisConfig
from drivers.master.plan.gearing import shown
from drivers.master.seen.boot_log import Change


def axis_settings(book: SettingsBook, axis: Axis, written: Sequence[Change] = ()) -> AxisSettingsReply:
    """What an axis is set to."""
    values = effective(book.settings(axis), axis.config)
    nothing = {key: "module" for key, value in values.items() if value is None and key in SETTINGS}
    return AxisSettingsReply(
        node=axis.node.node_id,
        axis=axis.number,
        name=axis.name,
        unit=axis.config.unit,
        units=list(axis.config.units),
        revision=book.revision,
        durable=book.durable,
        problem=book.problem,
        settings=AxisValues.model_validate(
            {key: value for key, value in values.items() if value is not None}
        ),
        sources={key: nothing.get(key) or book.source(axis, key) for key in values},
        objects=[
            HeldReply(
                setting=one.parameter.setting,
                index=f"0x{one.spec.index:04X}",
                sub=one.spec.sub,
                name=one.spec.name,
                value=one.value,
                unit=one.spec.unit,
                needs_disable=one.needs_power_off,
            )
            for one in wanted_objects(axis.config, axis.node.profile, axis.number)
        ],
        written=[change(one) for one in written],
    )


def effective(settings: AxisSettings, config: AxisConfig) -> dict[str, Any]:
    """Every setting as it counts, as JSON: as it was given, else the default in the axis's own unit."""
    given = settings.explicit()
    values: dict[str, Any] = {}
    for key in AxisValues.model_fields:
        if key in given:
            values[key] = given[key]
        elif key in DIMENSIONS:
            values[key] = _measure(key, config)
        else:
            values[key] = getattr(config, key, None)
    if config.gearing is None:
        values["steps_per_unit"] = given.get("steps_per_unit", shown(Fraction(config.steps_per_unit)))
        values |= dict.fromkeys(("full_steps", "microsteps", "direction"))
    else:
        gearing = config.gearing
        values |= {"full_steps": gearing.full_steps, "microsteps": gearing.microsteps}
        values |= {"gear": write_gear(gearing.gear), "direction": gearing.direction, "steps_per_unit": None}
    return values


def _measure(key: str, config: AxisConfig) -> dict[str, Any] | None:
    row = SETTINGS[key]
    counted: int | None = getattr(config, row.counts or key)
    if counted is None:
        return None
    unit = unit_of(key, config.unit)
    size = units_of(key, config)[unit]
    value = Fraction(counted) / (size if row.signed else abs(size))
    return {"value": shown(value), "unit": unit}


def document(book: SettingsBook) -> dict[str, Any]:
    """All axes' settings as they would stand in the settings file."""
    nodes: dict[int, dict[str, Any]] = {}
    for axis in book.axes:
        node = axis.node
        entry = nodes.setdefault(
            node.node_id, {"id": node.node_id, "name": node.name, "model": node.config.model, "axes": []}
        )
        entry["axes"].append(book.settings(axis).written())
    return {"nodes": list(nodes.values())}


def json_reply(value: object) -> Response:
    """A document as it is, without a model that would fill in what it leaves out."""
    return Response(json.dumps(value, ensure_ascii=False), media_type="application/json")


def wanted(network: Network, book: SettingsBook, given: SettingsFile | None) -> Mapping[Axis, AxisSettings]:
    """The axes that a document names; without one, all with what they are set to.

    Raises `UnknownNode`, `UnknownAxis`, and `ApiError` (422) for what the module of that name is not.
    """
    if given is None:
        return {axis: book.settings(axis) for axis in book.axes}
    found: dict[Axis, AxisSettings] = {}
    for entry in given.nodes:
        node = network.node(entry.id)
        if (entry.name, entry.model) != (node.name, node.config.model):
            raise ApiError(
                "bad_value",
                f"Node {node.node_id} is {node.name}, a {node.config.model}, and not {entry.name}, a "
                f"{entry.model}; that can be changed in the settings file only.",
            )
        for settings in entry.axes:
            found[node.axis(settings.name)] = settings
    return found


async def compare(book: SettingsBook, axes: Mapping[Axis, AxisSettings]) -> DiffReply:
    """Settings against those that are gone by, and against what the modules hold now.

    Raises `RulesBroken`, and `ApiError` (422) for a number that is none.
    """
    fields: list[FieldDifference] = []
    objects: list[ObjectDifference] = []
    unread: dict[int, str] = {}
    compared = 0
    for axis, settings in axes.items():
        config = _config(settings, axis)
        fields += _fields(axis, book.settings(axis).explicit(), settings.explicit())
        try:
            for one in wanted_objects(config, axis.node.profile, axis.number):
                if axis.node.node_id in unread:
                    break
                held = await _held(axis, one.spec.address)
                compared += 1
                if held != one.value:
                    objects.append(
                        ObjectDifference(
                            node=axis.node.node_id,
                            axis=axis.number,
                            name=axis.name,
                            setting=one.parameter.setting,
                            index=f"0x{one.spec.index:04X}",
                            sub=one.spec.sub,
                            object=one.spec.name,
                            wanted=one.value,
                            held=held,
                            unit=one.spec.unit,
                            needs_disable=one.needs_power_off,
                        )
                    )
        except CanaxisError as error:
            unread[axis.node.node_id] = error.message
    return DiffReply(
        equal=not (fields or objects or unread),
        fields=fields,
        objects=objects,
        compared=compared,
        unread=[UnreadReply(node=node, reason=reason) for node, reason in unread.items()],
    )


def _config(settings: AxisSettings, axis: Axis) -> AxisConfig:
    try:
        config = settings.to_config()
    except ConfigurationError as error:
        raise ApiError("bad_value", str(error)) from error
    check_ranges(config, axis.node.profile, axis.number)
    return config


async def _held(axis: Axis, address: Any) -> int | None:
    try:
        value = await axis.node.read(address)
    except SdoAborted:
        return None
    return value if isinstance(value, int) else None


def _fields(axis: Axis, kept: Mapping[str, Any], wanted: Mapping[str, Any]) -> Iterable[FieldDifference]:
    for setting in AxisValues.model_fields:
        if kept.get(setting) != wanted.get(setting):
            yield FieldDifference(
                node=axis.node.node_id,
                axis=axis.number,
                name=axis.name,
                setting=setting,
                kept=kept.get(setting),
                wanted=wanted.get(setting),
            )


def applied(book: SettingsBook, written: Mapping[Axis, Sequence[Change]]) -> AppliedReply:
    """What a change wrote."""
    return AppliedReply(
        revision=book.revision,
        durable=book.durable,
        axes=[
            AppliedAxis(
                node=axis.node.node_id,
                axis=axis.number,
                name=axis.name,
                written=[change(one) for one in changes],
            )
            for axis, changes in written.items()
        ],
    )


def revisions(book: SettingsBook, found: Sequence[Revision]) -> RevisionList:
    """The revisions that were found."""
    return RevisionList(
        current=book.revision,
        revisions=[
            RevisionReply(
                revision=one.number,
                created=one.created,
                who=one.who,
                address=one.address,
                what=one.what,
                settings=dict(one.overlays),
                current=one.number == book.revision,
            )
            for one in found
        ],
    )
