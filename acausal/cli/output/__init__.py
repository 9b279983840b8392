"""What a command prints, and its errors."""
