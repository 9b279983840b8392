"""Transcription of an optimal-control problem into a nonlinear program."""
