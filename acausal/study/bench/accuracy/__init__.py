"""How far a run is from the truth."""
