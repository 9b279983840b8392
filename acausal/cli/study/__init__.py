"""Verbs that ask a model for more than one run, or for another form."""
