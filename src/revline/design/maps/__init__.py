"""Gains over a map of operating points: what holds everywhere, and schedules."""
