"""From vectors to scalar expressions, and their derivatives."""
