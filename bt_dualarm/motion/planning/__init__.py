"""Motions that touch nothing: straight where that is free, else by a search.

In: a `PlanningProblem`: the collision checker, start and goals, limits, a seed, the planner's name
and budget.
Out: a trajectory, or `NO_PLAN`; the search (OMPL, RRT-Connect) runs in a process of its own.
Open first: `problem` (what a plan depends on; budget of checks); others: `ompl_search`,
`joint_motion`, `process` (the process and its pipes), `tool_path` (a tool path to a joint motion),
`give_way`, `planners`.
"""
