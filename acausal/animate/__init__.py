"""Runs of multibody models as moving scenes: glTF, one-file pages, moving pictures."""
