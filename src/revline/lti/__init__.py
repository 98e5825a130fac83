"""Linear models with exact delays: frequency responses, transfer functions, state spaces, roots."""
