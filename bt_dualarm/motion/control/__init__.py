"""The joint controller of an arm: from what skills ask for to torques.

In: trajectories and streams of set-points, what the arm's sensors say, reservations of other arms.
Out: torques that follow the set-points, within the joints' efforts; the reason of a failure.
Open first: `controller` (what happens each period); others: `computed_torque`, `state_observer`,
`momentum_observer` (touch), `trouble` (reasons), `weighing`, `effort` (what an arm can carry).
"""
