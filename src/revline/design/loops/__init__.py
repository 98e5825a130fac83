"""Closed loops in time, continuous and sampled: how they end, and the limit cycles that they hunt in."""
