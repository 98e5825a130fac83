"""revline: engine models with transport delay, from nonlinear simulation to proven controllers, with the delay exact."""
