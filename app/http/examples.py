"""The examples of the API's document: one for each body, and lists made of them."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict

Example = dict[str, Any]


def shown(example: Example) -> ConfigDict:
    """The part of a model's configuration that shows an example of it."""
    return ConfigDict(json_schema_extra={"examples": [example]})


TIME = "2026-01-01T12:00:00Z"
MOVE: Example = {
    "target": 51200,
    "relative": False,
    "unit": "steps",
    "velocity": 51200,
    "acceleration": 102400,
}
VELOCITY: Example = {"velocity": 100000, "unit": "steps"}
HOME: Example = {"method": 19}
SET_POSITION: Example = {"position": 0, "unit": "steps"}
GO: Example = {"position": "park"}
TEACH: Example = {"position": 51200, "unit": "steps"}
NAMED_POSITION: Example = {
    "name": "park",
    "position": {"steps": 51200, "value": 51200.0, "unit": "steps"},
    "unreferenced": False,
    "within_limits": True,
    "taught": TIME,
    "taught_by": "anonymous",
}
OBSTACLE: Example = {
    "code": "not_enabled",
    "message": "The axis is switch_on_disabled.",
    "remedy": "Enable the axis.",
    "action": {"method": "POST", "path": "/api/v1/nodes/1/axes/0/enable", "body": {}},
}
AXIS: Example = {
    "node": 1,
    "axis": 0,
    "name": "x",
    "state": "operation_enabled",
    "mode": "profile_position",
    "statusword": "0x1637",
    "position": {"steps": 51200, "value": 51200.0, "unit": "steps"},
    "velocity": {"steps": 0, "value": 0.0, "unit": "steps/s"},
    "target_reached": True,
    "moving": False,
    "referenced": False,
    "reference": "unknown",
    "adopted": False,
    "found": None,
    "limits": {"negative": False, "positive": False},
    "home_switch": False,
    "emergencies": [],
    "operation": None,
    "queued": [],
    "lease": None,
    "age_s": 0.012,
    "stale": False,
}
LEASE_BODY: Example = {
    "axes": [{"node": "stage", "axis": "x"}, {"node": "stage", "axis": "y"}],
    "ttl_s": 10,
    "owner": "scheduler 1",
}
LEASE: Example = {
    "id": "0d4b7a6a5f9b4b7f8f3b6c1f0e2d9a11",
    "fencing": 1767268800000,
    "owner": "scheduler 1",
    "axes": [{"node": 1, "axis": 0, "name": "x"}, {"node": 1, "axis": 1, "name": "y"}],
    "ttl_s": 10.0,
    "created": TIME,
    "expires": "2026-01-01T12:00:10Z",
    "expires_in_s": 10.0,
    "links": {
        "self": "/api/v1/leases/0d4b7a6a5f9b4b7f8f3b6c1f0e2d9a11",
        "renew": "/api/v1/leases/0d4b7a6a5f9b4b7f8f3b6c1f0e2d9a11/renew",
        "release": "/api/v1/leases/0d4b7a6a5f9b4b7f8f3b6c1f0e2d9a11/release",
    },
}
READINESS: Example = {
    "ready": False,
    "enable": [],
    "disable": [],
    "reset_fault": [],
    "move": [OBSTACLE],
    "velocity": [OBSTACLE],
    "home": [OBSTACLE],
    "set_position": [],
    "jog": [OBSTACLE],
}
PREVIEW: Example = {
    "dry_run": True,
    "kind": "move",
    "node": 1,
    "axis": 0,
    "name": "x",
    "accepted": False,
    "begins": None,
    "obstacles": [OBSTACLE],
    "request": {"target": 51200, "unit": "steps", "relative": False, "target_steps": 51200},
    "predicted_s": 1.5,
    "predicted_peak_velocity": {"steps": 51200, "value": 51200.0, "unit": "steps/s"},
    "start": {"steps": 0, "value": 0.0, "unit": "steps"},
    "end": {"steps": 51200, "value": 51200.0, "unit": "steps"},
    "path": {
        "lowest": {"steps": 0, "value": 0.0, "unit": "steps"},
        "highest": {"steps": 51200, "value": 51200.0, "unit": "steps"},
        "limit_low": {"steps": -100000, "value": -100000.0, "unit": "steps"},
        "limit_high": {"steps": 100000, "value": 100000.0, "unit": "steps"},
        "within": True,
    },
    "assumed": [],
    "writes": [
        {
            "index": "0x6081",
            "sub": 0,
            "name": "Profile velocity",
            "axis": 0,
            "old": None,
            "new": 51200,
            "unit": "steps/s",
        }
    ],
}
OPERATION: Example = {
    "id": "6f1c2a7b9d3e4f506f1c2a7b9d3e4f50",
    "kind": "move",
    "node": 1,
    "axis": 0,
    "axes": [{"node": 1, "axis": 0, "name": "x"}],
    "state": "running",
    "progress": 0.4,
    "request": {
        "target": 51200,
        "unit": "steps",
        "relative": False,
        "target_steps": 51200,
        "target_commanded": 51200,
        "rounded_by": 0,
    },
    "result": None,
    "error": None,
    "reason": None,
    "asked_by": {"name": "anonymous", "address": "127.0.0.1"},
    "evidence": {
        "axes": [
            {
                "node": 1,
                "axis": 0,
                "start": {"steps": 0, "value": 0.0, "unit": "steps"},
                "target": {"steps": 51200, "value": 51200.0, "unit": "steps"},
                "end": None,
            }
        ],
        "statuswords": [
            {
                "node": 1,
                "axis": 0,
                "after_s": 0.012,
                "statusword": "0x5237",
                "position": {"steps": 12, "value": 12.0, "unit": "steps"},
            }
        ],
        "left_out": 0,
        "emergencies": [],
        "found": [],
    },
    "created": TIME,
    "started": TIME,
    "ended": None,
    "links": {
        "self": "/api/v1/operations/6f1c2a7b9d3e4f506f1c2a7b9d3e4f50",
        "cancel": "/api/v1/operations/6f1c2a7b9d3e4f506f1c2a7b9d3e4f50/cancel",
        "axis": "/api/v1/nodes/1/axes/0",
    },
}
NODE: Example = {
    "node": 1,
    "name": "stage",
    "model": "TMCM-3216",
    "state": "operational",
    "reason": "",
    "nmt_state": "operational",
    "identity": {
        "device_type": "0xFFFC0192",
        "vendor_id": "0x00000286",
        "product_code": "0x00000C90",
        "revision": 1,
        "serial": 1,
    },
    "device_name": "TMCM-3216",
    "hardware_version": "1.0",
    "software_version": "1.04",
    "serial": 1,
    "failsafe": "unverified",
    "heartbeat_age_s": 0.1,
    "boot": {
        "complete": True,
        "took_s": 0.21,
        "steps": [
            {
                "name": "heartbeats",
                "state": "done",
                "compared": 3,
                "written": 1,
                "changes": [
                    {
                        "index": "0x1017",
                        "sub": 0,
                        "name": "Producer heartbeat time",
                        "axis": None,
                        "old": 0,
                        "new": 500,
                        "unit": "ms",
                    }
                ],
                "note": "Fail-safe: unverified.",
                "reason": "",
                "remedy": "",
                "took_s": 0.004,
            }
        ],
    },
    "axes": [{"axis": 0, "name": "x", "unit": "steps", "path": "/api/v1/nodes/1/axes/0"}],
    "counters": {"heartbeats": 12},
}
EMERGENCY: Example = {
    "id": 1,
    "time": TIME,
    "node": 1,
    "axis": None,
    "code": "0x8130",
    "register": "0x11",
    "data": "00 00 00 00 00",
    "title": "Heartbeat lost",
    "cause": "The module did not hear the master in time.",
    "remedy": "Check the cable and that the service runs, then reset the fault.",
    "severity": "fault",
    "active": True,
}
INPUTS: Example = {
    "node": 1,
    "digital": [{"number": 0, "name": "IN0", "on": True}],
    "analog": [{"number": 0, "name": "AIN0", "raw": 2048, "volts": None}],
    "switches": [{"axis": 0, "name": "x.home", "on": False, "age_s": 0.012, "stale": False}],
    "age_s": 0.003,
}
OUTPUT: Example = {"node": 1, "number": 0, "name": "OUT0", "on": True, "usable": True, "push_pull": False}
OUTPUT_BODY: Example = {"on": True}
WAIT: Example = {"input": "IN0", "becomes": True, "timeout_s": 30}
MOVES: Example = {
    "targets": [
        {"node": "stage", "axis": "x", "target": 51200, "unit": "steps"},
        {"node": "stage", "axis": "y", "target": -12800, "unit": "steps", "relative": True},
    ],
    "duration_s": 2.5,
}
OBJECT: Example = {
    "node": 1,
    "index": "0x6064",
    "sub": 0,
    "name": "Position actual value",
    "type": "I32",
    "access": "ro",
    "unit": "steps",
    "value": 51200,
    "meanings": [],
}
OBJECT_WRITE: Example = {"value": 51200, "confirm": False}
BUS: Example = {
    "name": "socketcan:can0",
    "state": "active",
    "reason": "",
    "warnings": [],
    "counters": {"received": 1200, "sent": 300},
}
STOP: Example = {"reason": "A hand is in the way."}
STOP_STATE: Example = {"latched": True, "reason": "A hand is in the way.", "time": TIME}
STOP_REPORT: Example = {
    **STOP_STATE,
    "complete": True,
    "axes": [{"node": 1, "axis": 0, "outcome": "stopped", "message": "Axis x stands."}],
}
LIVE: Example = {"status": "alive"}
READY: Example = {"ready": False, "reasons": ["Node 1 (stage) is absent."], "warnings": []}
TICKET: Example = {"ticket": "Q2lyY3VsYXIgZG9vcnMgYXJlIHJhcmUu", "role": "read", "expires_in_s": 30.0}
SERVICE: Example = {"name": "canaxis", "version": "0.1.0", "links": {"nodes": "/api/v1/nodes"}}
PROBLEM_TYPE: Example = {
    "type": "/problems/not-ready",
    "code": "not_ready",
    "status": 409,
    "title": "Axis not ready",
    "explanation": "The list `obstacles` names what prevents the command, and its remedy.",
}
