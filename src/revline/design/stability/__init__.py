"""Linear loops with their delay exact: stability, margins, and the distance between plants."""
