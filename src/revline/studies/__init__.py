"""The whole study as one chain of values."""
