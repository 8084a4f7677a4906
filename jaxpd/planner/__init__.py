"""Model no more than a scene needs: the cheapest adequate method, with its reasons.

look      what a scene holds: counts and flags
less      what it models without need
wanted    resolutions that meet an accuracy, of the theories that can
duty      operator, solver, memory, precision of a resolution
cost      processor seconds and memory, a calibrated model
error     expected errors, from measured ones
plan      the result: data that prints as a table and runs
choose    the door: `plan`
"""

from jaxpd.planner.choose import changed, plan
from jaxpd.planner.cost import Cost
from jaxpd.planner.plan import Plan
from jaxpd.planner.words import which_when

__all__ = ["Cost", "Plan", "changed", "plan", "which_when"]
