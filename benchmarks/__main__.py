"""All benchmarks: `python benchmarks`. Tables in Markdown on standard output; about ten minutes on two cores."""

import peers
import speed

speed.main()
peers.main()
