"""Systems of one model that share no equation, as compiled models of their own."""
