"""Controllers as they run: their law, their forms, continuous, sampled and scheduled."""
