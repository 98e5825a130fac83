"""Files: engines, responses, controllers, runs, results."""
