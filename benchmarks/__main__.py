"""All benchmarks of speed: `python benchmarks`. Tables in Markdown on standard output; about half an hour on two cores.

What is found, not how fast, is measured by commands of their own: `adaptation.py`, `ant.py`, `comparison.py`, `hexapod.py`,
`readings.py`, `sphere.py`.

    python benchmarks
    python benchmarks --quick    # to see it work: no conclusions can be drawn
"""

import argparse

import cells
import endurance
import hockey
import learned
import peers
import robots
import speed

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--quick", action="store_true", help="as that of each of them")
quick = parser.parse_args().quick
speed.main(quick)
hockey.main(quick)
endurance.main(quick)
learned.main(quick)
cells.main(quick)
robots.main(quick)
peers.main(quick)
