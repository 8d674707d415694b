"""All experiments that can be repeated, by name, and all that was claimed of their results."""

from auroraqd.experiments import follow_up, paper_claims
from auroraqd.experiments.follow_up import FOLLOW_UP
from auroraqd.experiments.variants import AIR_HOCKEY, BALLISTIC

EXPERIMENTS = {experiment.name: experiment for experiment in (BALLISTIC, AIR_HOCKEY, FOLLOW_UP)}
CLAIMS = (*paper_claims.CLAIMS, *follow_up.CLAIMS)
