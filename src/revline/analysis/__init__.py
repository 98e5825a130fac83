"""What a system does: trim, operating range, linearisation, responses, linearity. Any system, no engine by name."""
