"""Tuning rules, and the ultimate gain from model and experiment."""
