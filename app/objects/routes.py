"""Raw access to a node's object dictionary; writing is guarded."""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import Depends, Path

from app.axes.deps import NodeDep
from app.http.documentation import KEYS, LEASES, NODE, TRANSFER, UNSAFE, problems
from app.http.paths import API
from app.http.problems import ApiError
from app.http.routing import Router
from app.http.tasks import TasksDep
from app.idempotency.deps import command_headers
from app.objects.deps import ObjectsDep
from app.objects.schemas import MeaningReply, ObjectBody, ObjectReply
from drivers.master import ObjectSpec
from drivers.master.node.node import Node

router = Router(f"{API}/nodes/{{node}}/objects", tags=["objects"])

IndexPath = Annotated[
    str,
    Path(
        description="Hexadecimal with 0x.",
        examples=["0x6064"],
        max_length=8,
        json_schema_extra={"pattern": "^0x[0-9A-Fa-f]{1,4}$"},
    ),
]
SubPath = Annotated[int, Path(ge=0, le=255, description="Decimal.", examples=[0])]


@router.get(
    "/{index}/{sub}", summary="Read an object", responses=problems(*NODE, "unknown_object", *TRANSFER)
)
async def read_object(node: NodeDep, index: IndexPath, sub: SubPath) -> ObjectReply:
    """Ask the node for an object's value. Bytes come in hexadecimal."""
    return await _read(node, node.spec(parse_index(index), sub))


@router.put(
    "/{index}/{sub}",
    summary="Write an object",
    dependencies=[Depends(command_headers)],
    responses=problems(
        *NODE,
        *UNSAFE,
        *KEYS,
        *LEASES,
        *TRANSFER,
        *("unknown_object", "objects_read_only", "guarded_object", "bad_value", "not_ready", "axis_busy"),
    ),
)
async def write_object(
    body: ObjectBody, objects: ObjectsDep, tasks: TasksDep, node: NodeDep, index: IndexPath, sub: SubPath
) -> ObjectReply:
    """Write an object past the axis, and read it back. Off unless the settings allow it."""
    if not objects.writable:
        raise ApiError("objects_read_only", "The settings don't allow writing objects.")
    return await tasks.command(_write(node, node.spec(parse_index(index), sub), body))


async def _write(node: Node, spec: ObjectSpec, body: ObjectBody) -> ObjectReply:
    await node.write(spec.address, body.value, confirm=body.confirm)
    return await _read(node, spec) if spec.access.readable else _reply(node, spec, body.value)


async def _read(node: Node, spec: ObjectSpec) -> ObjectReply:
    value = await node.read(spec.address)
    return _reply(node, spec, value.hex(" ") if isinstance(value, bytes) else value)


def _reply(node: Node, spec: ObjectSpec, value: float | str | bool) -> ObjectReply:
    return ObjectReply(
        node=node.node_id,
        index=f"0x{spec.index:04X}",
        sub=spec.sub,
        name=spec.name if spec.name == spec.object_name else f"{spec.object_name}: {spec.name}",
        type=spec.type.short,
        access=spec.access.value,
        unit=spec.unit,
        value=value,
        meanings=_meanings(node, spec, value),
    )


def _meanings(node: Node, spec: ObjectSpec, value: float | str | bool) -> list[MeaningReply]:
    if not isinstance(value, int):
        return []
    code = node.profile.explain_code(spec.address, value)
    rows = (*node.profile.explain_bits(spec.address, value), *(() if code is None else (code,)))
    return [MeaningReply(name=r.name, title=r.title, cause=r.cause, remedy=r.remedy) for r in rows]


def parse_index(text: str) -> int:
    """An object index in hexadecimal. Raises `ApiError` (422)."""
    if re.fullmatch(r"0[xX][0-9A-Fa-f]{1,4}", text) is None:
        raise ApiError(
            "bad_value", "The object index is written in hexadecimal with 0x.", hint="For example 0x6064."
        )
    return int(text, 16)
