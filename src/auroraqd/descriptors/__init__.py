"""Behavioural descriptors: what reads what, how observations are scaled, and what is learned from them."""
