"""Hypothesis without deadlines: the first example of a test compiles kernels."""

from hypothesis import settings

settings.register_profile("auroraqd", deadline=None, print_blob=True)
settings.load_profile("auroraqd")
