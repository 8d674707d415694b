"""All benchmarks: `python benchmarks`. Tables in Markdown on standard output; about half an hour on two cores."""

import argparse

import endurance
import hockey
import learned
import peers
import robots
import speed

argparse.ArgumentParser(description=__doc__).parse_args()
speed.main()
hockey.main()
endurance.main()
learned.main()
robots.main()
peers.main()
