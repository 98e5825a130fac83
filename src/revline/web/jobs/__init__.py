"""Long work: each job is a folder and a process of its own, which goes on when the server stops."""
