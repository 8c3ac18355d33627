"""`tendril view`: the robot in 3-D in a browser: live, from a log, from a data set, or as a diagnosis.

Served to this machine only. It listens and reads, and has no code that sends to a robot.
"""
