"""A task into a task: one that many workers evaluate, processes or a cluster, with the same results::

    with auroraqd.evaluate.over(auroraqd.evaluate.processes(8), my_robot, timeout=60) as task:
        aurora.run(task, generations=500)

What goes wrong in a worker does not end the run. A chunk of individuals whose evaluation raises, takes too long, or kills its
worker is tried again, on another worker, then cut in two until it is known which individual it was: that one is invalid, its
fitness NaN. A worker that fails what others do is set aside.
"""

from auroraqd.evaluate.executors import dask, processes
from auroraqd.evaluate.spread import Spread, over

__all__ = ["Spread", "dask", "over", "processes"]
