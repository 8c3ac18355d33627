"""`tendril log serve`: what a running daemon publishes, live for Foxglove."""
