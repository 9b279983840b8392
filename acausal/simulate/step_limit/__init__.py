"""How large fixed steps may be."""
