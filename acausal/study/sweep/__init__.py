"""Many runs of one model: grids, samples, workers, one table."""
