"""Fake. A level is a byte, as in ROS 2."""

from messages import Sequence, message
from std_msgs.msg import Header

KeyValue = message("KeyValue", key="", value="")
DiagnosticStatus = message(
    "DiagnosticStatus", level=b"\x00", name="", message="", hardware_id="", values=Sequence(KeyValue)
)
DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE = (
    b"\x00",
    b"\x01",
    b"\x02",
    b"\x03",
)
DiagnosticArray = message("DiagnosticArray", header=Header(), status=Sequence(DiagnosticStatus))
