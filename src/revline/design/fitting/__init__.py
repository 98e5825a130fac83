"""Fitting transfer functions to frequency responses, and choosing among them."""
