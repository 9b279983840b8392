"""What is typed behind a verb: models, settings, inputs, files, and what Tab completes."""
