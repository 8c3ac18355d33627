"""A robot that is watched: its accepted state, each day's numbers beside it, and alarms when it changes.

`store` keeps, `change` decides, `day` measures, `postures` does both for a position-controlled robot, `page` and `text`
show, `alarm` reports. `python -m tendril.watch` is the command line of `tendril gap accept`, `gap watch` and `gap
history`.
"""
