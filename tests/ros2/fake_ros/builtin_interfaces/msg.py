"""Fake."""

from messages import message

Time = message("Time", sec=0, nanosec=0)
