"""What a run has computed, and what is put right before it is shown."""
