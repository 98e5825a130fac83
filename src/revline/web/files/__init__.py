"""A user's own files: checked, shown, fitted and compared with the engine of a state; text in, record out."""
