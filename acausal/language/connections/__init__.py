"""How components are joined."""
