"""Settings: of one axis, of all as a document, their revisions; and the module's own memory."""

from __future__ import annotations

from typing import Annotated

from fastapi import Body, Depends, Header, Query, Request, Response

from app.axes.deps import AxisDep, NodeDep, every_axis
from app.http.documentation import AXIS, NODE, NODE_COMMAND, SETTINGS_CHANGE, problems
from app.http.finding import NetworkDep
from app.http.paths import API
from app.http.problems import ApiError
from app.http.routing import Router
from app.http.tasks import TasksDep
from app.idempotency.deps import AskerDep, command_headers
from app.settings import views
from app.settings.book import MOST_REVISIONS
from app.settings.deps import BookDep
from app.settings.schemas import (
    AppliedReply,
    AxisSettingsPatch,
    AxisSettingsReply,
    DiffReply,
    RevisionList,
    RollbackBody,
    SettingsFile,
    StoreBody,
    StoreReply,
)
from drivers.master.node import storing
from drivers.master.node.storing import StoredGroup

YAML = "application/yaml"
_ETAG = {"ETag": {"description": "Of the axis's settings.", "schema": {"type": "string"}}}

axis_settings = Router(f"{API}/nodes/{{node}}/axes/{{axis}}/settings", tags=["settings"])
router = Router(f"{API}/settings", tags=["settings"])
memory = Router(
    f"{API}/nodes/{{node}}",
    tags=["settings"],
    dependencies=[Depends(command_headers)],
    responses=problems(*NODE_COMMAND, "unknown_axis", "axis_busy"),
)

IfMatch = Annotated[
    str | None,
    Header(alias="If-Match", max_length=255, description="The ETag that the change was made from, or `*`."),
]


@axis_settings.get(
    "", summary="What an axis is set to", responses={200: {"headers": _ETAG}, **problems(*AXIS)}
)
async def get_axis_settings(axis: AxisDep, book: BookDep, response: Response) -> AxisSettingsReply:
    """Every setting with its unit, where it comes from, and which object holds it. Costs the bus nothing."""
    response.headers["ETag"] = book.etag(axis)
    return views.axis_settings(book, axis)


@axis_settings.patch(
    "",
    summary="Change settings of an axis",
    dependencies=[Depends(command_headers)],
    responses={
        200: {"headers": _ETAG},
        **problems(*AXIS, *SETTINGS_CHANGE, "precondition_required", "precondition_failed"),
    },
)
async def patch_axis_settings(
    body: AxisSettingsPatch,
    axis: AxisDep,
    book: BookDep,
    tasks: TasksDep,
    asker: AskerDep,
    response: Response,
    if_match: IfMatch = None,
) -> AxisSettingsReply:
    """Merge (RFC 7396): what is left out stays, null is the default.

    Written to the module with read-back, then kept, then gone by at once; if anything fails, all of it is
    taken back and the old settings stay. Refused while the axis moves; units, switches, encoder and brake
    need it disabled. The maxima bind commands from now on.
    """
    if if_match is None:
        raise ApiError("precondition_required", "Settings are changed only with If-Match.")

    def check() -> None:
        tags = {tag.strip() for tag in if_match.split(",")}
        if "*" not in tags and book.etag(axis) not in tags:
            raise ApiError(
                "precondition_failed", f"The settings of axis {axis.name} are not those of If-Match."
            )

    given = body.model_dump(mode="json", exclude_unset=True)
    written = await tasks.command(book.patch(axis, given, asker.reply, check))
    response.headers["ETag"] = book.etag(axis)
    return views.axis_settings(book, axis, written)


@router.get(
    "",
    summary="All settings as a document",
    response_model=SettingsFile,
    responses={
        200: {"description": "As JSON, or as YAML where Accept names application/yaml."},
        **problems(),
    },
)
async def export_settings(request: Request, book: BookDep) -> Response:
    """What `canaxis.yaml` would say under `nodes` for the settings of now: to edit, compare and apply."""
    document = views.document(book)
    if "yaml" in request.headers.get("accept", ""):
        import yaml  # here: a service that is not asked for YAML starts without it

        text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True)
        return Response(text, media_type=YAML)
    return views.json_reply(document)


@router.post(
    "/diff",
    summary="Compare a document, the settings and the modules",
    responses=problems(
        *NODE, *AXIS, "forbidden_role", "request_timeout", "body_too_large", "json_required", "bad_value"
    ),
)
async def diff_settings(
    network: NetworkDep, book: BookDep, body: Annotated[SettingsFile | None, Body()] = None
) -> DiffReply:
    """What applying a document would change, setting by setting and object by object, read from the modules.

    Without a body: the settings that are gone by against what the modules hold. Reads only. What a command
    gave last (6081h, 6083h, 6084h, 6098h) differs until the next command without it.
    """
    return await views.compare(book, views.wanted(network, book, body))


@router.post(
    "/apply",
    summary="Go by a document",
    dependencies=[Depends(command_headers), Depends(every_axis)],
    responses=problems(*AXIS, *SETTINGS_CHANGE),
)
async def apply_settings(
    body: SettingsFile, network: NetworkDep, book: BookDep, tasks: TasksDep, asker: AskerDep
) -> AppliedReply:
    """All or nothing over the axes that it names: written, read back, kept; else all is as it was."""
    written = await tasks.command(book.apply(views.wanted(network, book, body), asker.reply))
    return views.applied(book, written)


@router.get("/revisions", summary="Changes of settings", responses=problems("history_off"))
async def list_revisions(
    book: BookDep, limit: Annotated[int, Query(ge=1, le=MOST_REVISIONS)] = 50
) -> RevisionList:
    """Who changed what and when, the newest first."""
    return views.revisions(book, await book.revisions(limit))


@router.post(
    "/rollback",
    summary="Go back to a revision",
    dependencies=[Depends(command_headers), Depends(every_axis)],
    responses=problems(*SETTINGS_CHANGE, "unknown_revision"),
)
async def roll_back_settings(
    body: RollbackBody, book: BookDep, tasks: TasksDep, asker: AskerDep
) -> AppliedReply:
    """Go by what a revision said, as a new revision; 0 is the settings file alone."""
    written = await tasks.command(book.roll_back(body.revision, asker.reply))
    return views.applied(book, written)


@memory.post("/store", summary="Keep parameters in the module")
async def store_in_module(body: StoreBody, node: NodeDep, tasks: TasksDep) -> StoreReply:
    """Have the module start with what it holds now (1010h). Every axis of the node must be disabled."""
    axis = None if body.axis is None else node.axis(body.axis)
    number = None if axis is None else axis.number
    await tasks.command(storing.store(node, StoredGroup(body.what), number))
    return StoreReply(
        node=node.node_id,
        what=body.what,
        axis=number,
        note="The module starts with what it holds now; this service still writes its own settings over it.",
    )


@memory.post("/restore-defaults", summary="Give a module its defaults back")
async def restore_module_defaults(body: StoreBody, node: NodeDep, tasks: TasksDep) -> StoreReply:
    """Have the module start with its maker's defaults (1011h). Every axis of the node must be disabled."""
    axis = None if body.axis is None else node.axis(body.axis)
    number = None if axis is None else axis.number
    await tasks.command(storing.restore_defaults(node, StoredGroup(body.what), number))
    return StoreReply(
        node=node.node_id,
        what=body.what,
        axis=number,
        note="Nothing changes before the module is reset or its supply is cut; then this service writes its "
        "own settings over the defaults again.",
    )
