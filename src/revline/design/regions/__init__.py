"""Gains that stabilise a loop, its delay exact."""
