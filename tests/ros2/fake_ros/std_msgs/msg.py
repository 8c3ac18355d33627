"""Fake."""

from builtin_interfaces.msg import Time
from messages import Sequence, message

Header = message("Header", stamp=Time(), frame_id="")
Float64MultiArray = message("Float64MultiArray", data=Sequence(float))
