"""What equations are made of."""
