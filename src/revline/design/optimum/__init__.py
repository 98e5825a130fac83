"""Gains of least error under bounds."""
