"""Every call of the service that the client knows: paths, bodies and the kinds of the answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any
from urllib.parse import quote

from canaxis.contract.exchange import Call, Request, TaggedCall, asking, command, look, stop
from canaxis.contract.options import (
    AnalogOptions,
    GoOptions,
    HomeOptions,
    MoveOptions,
    SetPositionOptions,
    Target,
    TeachOptions,
    TogetherOptions,
    VelocityOptions,
    WaitOptions,
)
from canaxis.contract.path import PathBody
from canaxis.contract.reading import read
from canaxis.errors import BadValue
from canaxis.obstacles import Action
from canaxis.replies import (
    AxisSettings,
    AxisStatus,
    AxisStatuses,
    BusStatus,
    Emergencies,
    Inputs,
    Lease,
    LeaseGranted,
    MovesPrediction,
    NamedPosition,
    NamedPositions,
    NodeStatus,
    NodeStatuses,
    ObjectValue,
    OperationStatus,
    OperationStatuses,
    Output,
    Outputs,
    Preview,
    Readiness,
    Ready,
    StopReport,
    StopState,
)

ROOT = "/api/v1"
LOOKING = 600.0
"""Seconds that the service may take to look at a path, beyond what any answer may take."""


def _name(reference: int | str) -> str:
    text = str(reference)
    if text.strip(".") == "":
        raise BadValue(f"{text!r} is no name of a node, an axis or an operation.", hint="Look at nodes().")
    return quote(text, safe="")


def _body(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if name != "key" and value is not None}


def _preview(path: str, options: Mapping[str, Any]) -> Call[Preview]:
    request = Request("POST", path, query={"dry_run": "true"}, body=_body(options), safe=True)
    return asking(request, Preview)


def _started(path: str, options: Mapping[str, Any]) -> Call[OperationStatus]:
    return asking(command(path, _body(options), key=options.get("key")), OperationStatus)


def _tagged(request: Request) -> Call[AxisSettings]:
    return TaggedCall(request, lambda data: read(AxisSettings, data))


class AxisCalls:
    """The calls of one axis."""

    def __init__(self, node: int | str, axis: int | str) -> None:
        self.path = f"{ROOT}/nodes/{_name(node)}/axes/{_name(axis)}"

    def status(self) -> Call[AxisStatus]:
        """GET."""
        return asking(look(self.path), AxisStatus)

    def readiness(self) -> Call[Readiness]:
        """GET readiness."""
        return asking(look(f"{self.path}/readiness"), Readiness)

    def enable(self) -> Call[AxisStatus]:
        """POST enable."""
        return self._state("enable")

    def disable(self) -> Call[AxisStatus]:
        """POST disable."""
        return self._state("disable")

    def reset_fault(self) -> Call[AxisStatus]:
        """POST reset-fault."""
        return self._state("reset-fault")

    def stop(self) -> Call[AxisStatus]:
        """POST stop."""
        return asking(stop(f"{self.path}/stop"), AxisStatus)

    def quick_stop(self) -> Call[AxisStatus]:
        """POST quick-stop."""
        return asking(stop(f"{self.path}/quick-stop"), AxisStatus)

    def move(self, target: float, unit: str, options: MoveOptions) -> Call[OperationStatus]:
        """POST move."""
        return _started(f"{self.path}/move", {"target": target, "unit": unit, **options})

    def velocity(self, velocity: float, unit: str, options: VelocityOptions) -> Call[OperationStatus]:
        """POST velocity."""
        return _started(f"{self.path}/velocity", {"velocity": velocity, "unit": unit, **options})

    def home(self, options: HomeOptions) -> Call[OperationStatus]:
        """POST home."""
        return _started(f"{self.path}/home", options)

    def predict_move(self, target: float, unit: str, options: MoveOptions) -> Call[Preview]:
        """POST move, dry."""
        return _preview(f"{self.path}/move", {"target": target, "unit": unit, **options})

    def predict_velocity(self, velocity: float, unit: str, options: VelocityOptions) -> Call[Preview]:
        """POST velocity, dry."""
        return _preview(f"{self.path}/velocity", {"velocity": velocity, "unit": unit, **options})

    def predict_home(self, options: HomeOptions) -> Call[Preview]:
        """POST home, dry."""
        return _preview(f"{self.path}/home", options)

    def go(self, position: str, options: GoOptions) -> Call[OperationStatus]:
        """POST move, to a named position."""
        return _started(f"{self.path}/move", {"position": position, **options})

    def settings(self) -> Call[AxisSettings]:
        """GET settings."""
        return _tagged(look(self._settings))

    def configure(self, changes: Mapping[str, Any], etag: str) -> Call[AxisSettings]:
        """PATCH settings."""
        keyed = command(self._settings, changes, method="PATCH")
        return _tagged(replace(keyed, headers={**keyed.headers, "If-Match": etag}))

    def set_position(self, position: float, unit: str, options: SetPositionOptions) -> Call[OperationStatus]:
        """POST set-position."""
        return _started(f"{self.path}/set-position", {"position": position, "unit": unit, **options})

    def positions(self) -> Call[NamedPositions]:
        """GET positions."""
        return asking(look(f"{self.path}/positions"), NamedPositions)

    def teach(self, name: str, options: TeachOptions) -> Call[NamedPosition]:
        """PUT positions."""
        body = {field: value for field, value in options.items() if value is not None}
        return asking(command(self._position(name), body, method="PUT"), NamedPosition)

    def forget_position(self, name: str) -> Call[NamedPosition]:
        """DELETE positions."""
        return asking(command(self._position(name), method="DELETE"), NamedPosition)

    def _position(self, name: str) -> str:
        return f"{self.path}/positions/{_name(name)}"

    @property
    def _settings(self) -> str:
        return f"{self.path}/settings"

    def _state(self, verb: str) -> Call[AxisStatus]:
        return asking(command(f"{self.path}/{verb}"), AxisStatus)


class NodeCalls:
    """The calls of one node."""

    def __init__(self, node: int | str) -> None:
        self.path = f"{ROOT}/nodes/{_name(node)}"

    def status(self) -> Call[NodeStatus]:
        """GET."""
        return asking(look(self.path), NodeStatus)

    def axes(self) -> Call[AxisStatuses]:
        """GET axes."""
        return asking(look(f"{self.path}/axes"), AxisStatuses)

    def emergencies(self) -> Call[Emergencies]:
        """GET emergencies."""
        return asking(look(f"{self.path}/emergencies"), Emergencies)

    def boot(self) -> Call[NodeStatus]:
        """POST boot."""
        return asking(command(f"{self.path}/boot"), NodeStatus)

    def verify_failsafe(self) -> Call[NodeStatus]:
        """POST verify-failsafe."""
        return asking(command(f"{self.path}/verify-failsafe"), NodeStatus)

    def read(self, index: int, sub: int) -> Call[ObjectValue]:
        """GET objects."""
        return asking(look(self._object(index, sub)), ObjectValue)

    def write(self, index: int, sub: int, value: float | str | bool, *, confirm: bool) -> Call[ObjectValue]:
        """PUT objects."""
        body = {"value": value, "confirm": confirm}
        return asking(command(self._object(index, sub), body, method="PUT"), ObjectValue)

    def inputs(self) -> Call[Inputs]:
        """GET inputs."""
        return asking(look(f"{self.path}/inputs"), Inputs)

    def outputs(self) -> Call[Outputs]:
        """GET outputs."""
        return asking(look(f"{self.path}/outputs"), Outputs)

    def switch_output(self, output: int | str, *, on: bool) -> Call[Output]:
        """POST outputs."""
        return asking(command(f"{self.path}/outputs/{_name(output)}", {"on": on}), Output)

    def wait_for_input(
        self, input_: int | str, *, becomes: bool, options: WaitOptions
    ) -> Call[OperationStatus]:
        """POST waits, for a digital input."""
        return _started(f"{self.path}/waits", {"input": input_, "becomes": becomes, **options})

    def wait_for_analog(self, analog: int, unit: str, options: AnalogOptions) -> Call[OperationStatus]:
        """POST waits, for an analog input."""
        return _started(f"{self.path}/waits", {"analog": analog, "unit": unit, **options})

    def _object(self, index: int, sub: int) -> str:
        return f"{self.path}/objects/0x{index:04X}/{sub}"


class OperationCalls:
    """The calls of one operation."""

    def __init__(self, operation: str) -> None:
        self.path = f"{ROOT}/operations/{_name(operation)}"

    def status(self, wait: float = 0.0) -> Call[OperationStatus]:
        """GET; the answer comes when it ended, at the latest after `wait` seconds."""
        query = {"wait": round(wait, 3)} if wait > 0 else {}
        return asking(Request("GET", self.path, query=query, waits=wait, safe=True), OperationStatus)

    def cancel(self) -> Call[OperationStatus]:
        """POST cancel."""
        return asking(command(f"{self.path}/cancel"), OperationStatus)


def follow(action: Action) -> Call[None]:
    """Whatever an obstacle's action is."""
    return Call(command(action.path, action.body, method=action.method), lambda _: None)


def nodes() -> Call[NodeStatuses]:
    """GET nodes."""
    return asking(look(f"{ROOT}/nodes"), NodeStatuses)


def operations(limit: int, state: str | None, before: str | None) -> Call[OperationStatuses]:
    """GET operations."""
    query = {"limit": limit, "state": state, "before": before}
    return asking(look(f"{ROOT}/operations", query), OperationStatuses)


def move_together(targets: Sequence[Target], options: TogetherOptions) -> Call[OperationStatus]:
    """POST moves."""
    return _started(f"{ROOT}/moves", {"targets": [dict(target) for target in targets], **options})


def predict_together(targets: Sequence[Target], options: TogetherOptions) -> Call[MovesPrediction]:
    """POST moves, dry."""
    body = _body({"targets": [dict(target) for target in targets], **options})
    request = Request("POST", f"{ROOT}/moves", query={"dry_run": "true"}, body=body, safe=True)
    return asking(request, MovesPrediction)


def stop_all(reason: str) -> Call[StopReport]:
    """POST stop."""
    return asking(stop(f"{ROOT}/stop", {"reason": reason}), StopReport)


def stop_state() -> Call[StopState]:
    """GET stop."""
    return asking(look(f"{ROOT}/stop"), StopState)


def reset_stop() -> Call[StopState]:
    """POST stop/reset."""
    return asking(command(f"{ROOT}/stop/reset"), StopState)


def bus() -> Call[BusStatus]:
    """GET bus."""
    return asking(look(f"{ROOT}/bus"), BusStatus)


def ready() -> Call[Ready]:
    """GET readyz: not ready is an answer too."""
    return asking(Request("GET", "/readyz", safe=True, accepts=frozenset({503})), Ready)


def take_lease(
    axes: Sequence[tuple[int | str, int | str]], ttl: float, owner: str | None, *, force: bool
) -> Call[LeaseGranted]:
    """POST leases."""
    body: dict[str, Any] = {"axes": [{"node": node, "axis": axis} for node, axis in axes]}
    body |= {"ttl_s": ttl, "force": force} | ({} if owner is None else {"owner": owner})
    return asking(command(f"{ROOT}/leases", body), LeaseGranted)


def renew_lease(lease: str) -> Call[Lease]:
    """POST renew."""
    return asking(command(f"{ROOT}/leases/{_name(lease)}/renew"), Lease)


def release_lease(lease: str, *, stop: bool) -> Call[Lease]:
    """POST release."""
    return asking(command(f"{ROOT}/leases/{_name(lease)}/release", {"stop": stop}), Lease)


def trajectory(body: PathBody, key: str | None) -> Call[OperationStatus]:
    """POST trajectories: the answer comes once the whole path was looked at."""
    keyed = command(f"{ROOT}/trajectories", key=key)
    headers = {**keyed.headers, "Content-Type": "application/json"}
    request = Request("POST", keyed.path, path_body=body, headers=headers, waits=LOOKING)
    return asking(request, OperationStatus)
