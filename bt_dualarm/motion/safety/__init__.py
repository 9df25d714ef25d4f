"""The guard of an arm: no arm meets another one, and none touches what it should not.

In: the set-point that an arm is about to send, and what the other arms have reserved.
Out: leave to go on, a time scale, a braking trajectory, or the reason to give up; a reservation.
Open first: `guard` (what it does each period); others: `failsafe` (an arm brakes for another arm),
`separation_rule` (how slow near bodies), `plan_monitor` (a plan against the world as it becomes).
"""
