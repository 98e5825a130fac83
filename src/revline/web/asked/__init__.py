"""Answers to single questions: the records that the command line prints with --json, from the same functions."""
