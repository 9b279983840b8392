"""The nonlinear program of a problem."""
