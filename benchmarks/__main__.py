"""All benchmarks: `python benchmarks`. Tables in Markdown on standard output; about half an hour on two cores."""

import learned
import peers
import speed

speed.main()
learned.main()
peers.main()
