"""Results of runs: their signals, and the files they are kept in."""
