"""The answer: its numbers, its errors, its pictures."""
