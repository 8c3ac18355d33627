"""The dashboard of `tendril status --watch`: shows a daemon's robot and operates it from the keyboard."""
