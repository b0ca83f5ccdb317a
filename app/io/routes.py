"""Inputs and outputs of a node, and waiting for an input."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Depends, Path

from app.axes.deps import NodeDep
from app.http.documentation import KEYS, LEASES, NODE, TRANSFER, UNSAFE, problems
from app.http.finding import LONGEST_REFERENCE
from app.http.paths import API
from app.http.problems import ApiError
from app.http.routing import Router
from app.http.tasks import TasksDep
from app.idempotency.deps import command_headers
from app.io import views
from app.io.schemas import InputsReply, OutputBody, OutputReply, OutputsReply, WaitBody
from app.operations.answers import ANSWERED
from app.operations.schemas import OperationReply
from app.operations.starting import StarterDep
from drivers.master.motions.motion import MotionKind
from drivers.master.node import conditions
from drivers.master.node.node import Node
from drivers.master.node.waiting import Condition

router = Router(f"{API}/nodes/{{node}}", tags=["terminals"])

OutputRef = Annotated[
    str,
    Path(
        description="Number or name of the output.",
        max_length=LONGEST_REFERENCE,
        min_length=1,
        examples=["0"],
    ),
]


@router.get("/inputs", summary="Inputs of a node", responses=problems(*NODE, *TRANSFER))
async def get_inputs(node: NodeDep) -> InputsReply:
    """Digital and analog inputs, asked for now, and the switches of the axes as they were last sent.

    Equal requests at the same time share the transfers.
    """
    loop = asyncio.get_running_loop()
    asked = loop.time()
    digital = await node.terminals.digital_levels()
    analog = await node.terminals.analog_levels()
    return views.inputs(node, digital, analog, loop.time() - asked)


@router.get("/outputs", summary="Outputs of a node", responses=problems(*NODE, *TRANSFER))
async def get_outputs(node: NodeDep) -> OutputsReply:
    """The digital outputs as the module holds them, asked for now."""
    levels = await node.terminals.output_levels()
    return OutputsReply(outputs=[views.output(node, level) for level in levels])


@router.post(
    "/outputs/{output}",
    summary="Switch an output",
    dependencies=[Depends(command_headers)],
    responses=problems(
        *(
            *NODE,
            *UNSAFE,
            *KEYS,
            *LEASES,
            *TRANSFER,
            "unknown_terminal",
            "not_ready",
            "stop_latched",
            "bad_value",
        )
    ),
)
async def switch_output(body: OutputBody, node: NodeDep, output: OutputRef, tasks: TasksDep) -> OutputReply:
    """Switch a digital output on or off; answers once that was read back. The others are left alone.

    Refused where the pin is an input, where the module may drive a brake with it, and, for on, while a stop
    is latched.
    """
    number = node.terminals.find_output(int(output) if output.isdecimal() and output.isascii() else output)
    return views.output(node, await tasks.command(node.terminals.switch(number, on=body.on)))


@router.post(
    "/waits",
    summary="Wait for an input",
    status_code=202,
    responses={
        **ANSWERED,
        **problems(
            *(*NODE, *UNSAFE, *KEYS, *TRANSFER, "lease_lost", "not_ready", "bad_value", "input_timeout")
        ),
    },
)
async def wait_for_input(body: WaitBody, node: NodeDep, starter: StarterDep) -> OperationReply:
    """Begin to wait until an input is as it should be: an operation that succeeds when that is seen.

    It succeeds at once if it is so already, and fails with `input_timeout`. Inputs are looked at 20 times a
    second, switches of an axis as often as the module sends them. It moves nothing, holds no axis, and no
    stop ends it.
    """
    condition = _condition(node, body)
    return await starter.start(
        MotionKind.WAIT_INPUT,
        node,
        body.model_dump(exclude_none=True) | {"name": condition.name},
        lambda operation_id: node.waits.begin(condition, body.timeout_s, operation_id=operation_id),
    )


def _condition(node: Node, body: WaitBody) -> Condition:
    if body.analog is None:
        assert body.input is not None, "the model says so"
        return conditions.digital(node, body.input, becomes=bool(body.becomes))
    scale = 1.0
    if body.unit == "V":
        volts = node.terminals.volts_per_count
        if volts is None:
            raise ApiError(
                "bad_value",
                f"Node {node.name} has no scale for volts: the manual gives none.",
                hint="Set analog_full_scale of the node, or give the value with unit raw.",
            )
        scale = volts
    above, below = (None if bound is None else bound / scale for bound in (body.above, body.below))
    return conditions.analog(node, body.analog, above=above, below=below)
