"""All benchmarks of speed: `python benchmarks`. Tables in Markdown on standard output; about half an hour on two cores.

What is found, not how fast, is measured by commands of their own: `adaptation.py`, `ant.py`, `comparison.py`, `hexapod.py`,
`readings.py`, `sphere.py`.
"""

import argparse

import cells
import endurance
import hockey
import learned
import peers
import robots
import speed

argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
speed.main()
hockey.main()
endurance.main()
learned.main()
cells.main()
robots.main()
peers.main()
