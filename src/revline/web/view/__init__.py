"""The parts of a page's view: each a function from a state to a record for JSON."""
