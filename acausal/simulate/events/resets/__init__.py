"""What follows a `reset` of states that constraints bind."""
