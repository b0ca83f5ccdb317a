"""The face: the command `canaxis` and the HTTP API. No CANopen knowledge lives here."""
