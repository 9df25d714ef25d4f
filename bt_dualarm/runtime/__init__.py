"""Running trees: assembly, the simulated clock, display, record and report.

Open first: `api`; `runner` has the order of one physics step.
"""
