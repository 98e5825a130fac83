"""Two inputs with two delays: mid-ranging against one input alone."""
