"""Models fitted to responses, controller rules, closed loops."""
