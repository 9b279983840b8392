"""What stands in a class body."""
