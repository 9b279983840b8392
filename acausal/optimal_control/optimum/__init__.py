"""Solution of an optimal-control problem: trajectories, multipliers, errors and plots."""
