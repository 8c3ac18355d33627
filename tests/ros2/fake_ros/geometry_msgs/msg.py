"""Fake."""

from messages import message
from std_msgs.msg import Header

Point = message("Point", x=0.0, y=0.0, z=0.0)
Quaternion = message("Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
Pose = message("Pose", position=Point(), orientation=Quaternion())
PointStamped = message("PointStamped", header=Header(), point=Point())
PoseStamped = message("PoseStamped", header=Header(), pose=Pose())
