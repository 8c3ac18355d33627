"""Fake."""


class Node:
    def __init__(self, *, package: str, executable: str, parameters: list, output: str) -> None:
        self.package, self.executable, self.parameters = package, executable, parameters
