"""Bodies in contact: normal laws, friction, and the search for pairs that can touch."""
