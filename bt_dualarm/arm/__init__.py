"""One arm in the hands of one leaf: where it is, how it moves, what it holds and sees.

In: the world, the arm's controller and camera, the planning process, the path of a leaf.
Out: `Arm`, which skills use; a `Failure` where it is busy, blocked, or held up by another arm.
Open first: `arm` (the public methods); others: `lease` (which leaf may move the arm), `execution`
(motions, halting), `planning` (plans and refusals), `move_to` (waiting, giving way, replanning),
`slip_response` (what is held stays held), `pull_sense` and `hold_signs` (how that is told).
"""
