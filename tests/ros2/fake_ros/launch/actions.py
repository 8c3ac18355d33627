"""Fake."""


class DeclareLaunchArgument:
    def __init__(self, name: str, *, default_value: str, description: str) -> None:
        self.name, self.default_value, self.description = name, default_value, description


class OpaqueFunction:
    def __init__(self, *, function) -> None:
        self.function = function


class LogInfo:
    def __init__(self, *, msg: str) -> None:
        self.msg = msg
