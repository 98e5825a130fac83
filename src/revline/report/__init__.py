"""Figures, tables and the report made of results."""
