"""Step two runs in parallel and compare them: an ideal robot and one in `lab`.

Prints::

    time   ideal to lab
    0.5 s   0.004 mm
    1.0 s   0.003 mm
    ...
    SUCCESS SUCCESS, at most 0.137 mm apart
    the same seed gives the same run: True
"""

import contextlib

import bt_dualarm as bt

with contextlib.ExitStack() as stack:
    # `ideal` is the nominal model of the controllers; `lab` samples friction, masses, drives and
    # encoders of a well-maintained robot with the seed.
    ideal, real = (
        stack.enter_context(bt.open("circle", params={"turns": 1}, reality=reality, seed=5))
        for reality in ("ideal", "lab")
    )
    farthest = 0.0
    print("time   ideal to lab")
    while not (ideal.done or real.done):
        for run in (ideal, real):
            run.step(0.5)
        apart = ideal.arms["arm1"].tool_pose.distance(real.arms["arm1"].tool_pose)
        farthest = max(farthest, apart)
        print(f"{ideal.time:.1f} s {1000 * apart:7.3f} mm")
    results = [run.finish() for run in (ideal, real)]

print(*(result.outcome for result in results), end=", ")
print(f"at most {1000 * farthest:.3f} mm apart")
again = bt.run("circle", params={"turns": 1}, reality="lab", seed=5)
print("the same seed gives the same run:", again.state_sha256 == results[1].state_sha256)
