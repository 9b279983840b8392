"""`acausal simulate`, and what belongs to one run."""
