"""Runs on disk: what a run is, as values; folders, checkpoints, and how it goes on from there."""
