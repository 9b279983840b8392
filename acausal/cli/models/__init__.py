"""Verbs about models: which there are, what they say, whether they are well posed."""
