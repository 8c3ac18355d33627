"""Fake."""


class MutuallyExclusiveCallbackGroup:
    pass
