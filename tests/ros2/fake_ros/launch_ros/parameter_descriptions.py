"""Fake."""


class ParameterValue:
    def __init__(self, value, *, value_type: type) -> None:
        self.value, self.value_type = value, value_type
