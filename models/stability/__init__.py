"""The stability gallery: small scenes in which a common method fails, each with an exact or high-accuracy answer.

Every class names its scene in `stability_scenes.json` of the reference data; docs/stability-gallery.md shows what
fails on each, how, and what is done here. `acausal stability CLASS` gives the verdict.
"""
