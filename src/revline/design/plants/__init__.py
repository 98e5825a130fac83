"""Plants of loops that are no engine: linear models as systems, held inputs, and which signals close a loop."""
