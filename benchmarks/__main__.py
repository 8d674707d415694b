"""All benchmarks: `python benchmarks`. Tables in Markdown on standard output; about half an hour on two cores."""

import argparse

import learned
import peers
import speed

argparse.ArgumentParser(description=__doc__).parse_args()
speed.main()
learned.main()
peers.main()
