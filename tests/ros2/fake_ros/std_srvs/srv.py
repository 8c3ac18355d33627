"""Fake."""

from messages import message


class Trigger:
    Request = message("Trigger_Request")
    Response = message("Trigger_Response", success=False, message="")
