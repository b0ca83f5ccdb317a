"""The software stop for everything. Always allowed; latched until it is reset on purpose."""

from __future__ import annotations

from fastapi import Depends, Request

from app.http.documentation import KEYS, UNSAFE, problems
from app.http.finding import NETWORK, NetworkDep
from app.http.parameters import empty_body
from app.http.paths import API
from app.http.routing import Router
from app.http.tasks import TASKS
from app.idempotency.deps import command_headers
from app.stop import views
from app.stop.schemas import StopBody, StopReply, StopState

router = Router(f"{API}/stop", tags=["stop"])


@router.post("", summary="Stop every axis", responses=problems(*UNSAFE))
async def stop_everything(request: Request, body: StopBody | None = None) -> StopReply:
    """Ramp every axis of every node down and refuse motion until the stop is reset. Needs no body.

    The answer says for each axis whether it was seen to stand. This is a software stop, not an emergency
    stop.
    """
    network, tasks = NETWORK.of(request.scope), TASKS.of(request.scope)  # past FastAPI: a stop waits for it
    reason = (body or StopBody()).reason
    return views.stop_report(await tasks.unconditional(network.stop_all(reason)))


@router.get("", summary="Whether a stop is latched", responses=problems())
async def get_stop(network: NetworkDep) -> StopState:
    """Whether motion is refused because everything was stopped, why, and since when."""
    return views.stop(network.stop_latched)


@router.post(
    "/reset",
    summary="Allow motion again",
    dependencies=[Depends(command_headers), Depends(empty_body)],
    responses=problems(*UNSAFE, *KEYS),
)
async def reset_stop(network: NetworkDep) -> StopState:
    """Release the latch. Nothing moves by itself: what was stopped must be commanded anew."""
    network.reset_stop()
    return views.stop(network.stop_latched)
