"""Callbacks: what looks at a run while it goes on."""
