"""How much less model a question needs: what was left out, what that gained, and what it cost in accuracy."""
