"""What the exports of logs and the live bridge share: messages as columns and as protobuf, the robot as a scene, log
lines, layouts. Knows nothing of files or of connections."""
