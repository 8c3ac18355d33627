"""Fake."""

from messages import Sequence, message
from std_msgs.msg import Header

JointState = message(
    "JointState",
    header=Header(),
    name=Sequence(str),
    position=Sequence(float),
    velocity=Sequence(float),
    effort=Sequence(float),
)
