"""Who is connected with whom, and what follows."""
