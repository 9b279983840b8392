"""The stability gallery: small scenes in which a common method fails, each with an exact or high-accuracy answer.

Every class names its scene in `stability_scenes.json` of the reference data; docs/stability-gallery.md shows which
methods fail on each, how, and the remedy used here. `acausal stability CLASS` gives the verdict.
"""
