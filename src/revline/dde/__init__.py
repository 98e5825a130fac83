"""Delay differential equations: history, breakpoints, compiled integration. Numerics only."""
