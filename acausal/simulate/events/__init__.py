"""Events: where they are, what they mean, what follows from them."""
