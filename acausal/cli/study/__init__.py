"""Commands that run a model many times, or write it in another form."""
