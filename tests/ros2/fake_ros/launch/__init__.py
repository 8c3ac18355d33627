"""Stands in for launch: a description is its list of actions, a context the values of the arguments."""


class LaunchContext:
    def __init__(self, **values: str) -> None:
        self.values = values


class LaunchDescription:
    def __init__(self, actions: list) -> None:
        self.actions = actions
