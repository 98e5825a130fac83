"""Acceptance on the sampled, noisy, nonlinear plant, and how far hunting is."""
