"""Mistakes in the trees themselves: keys, times, leaves that exclude each other."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.why_mistake import Mistake, Tree, box, shipped, steps


def of_blackboard() -> Iterator[Mistake]:
    """Keys that are not written in time, and conditions that do not hold."""
    tree = shipped("reach_to_pose")
    steps(tree)[0]["reach_to_pose"] = {"offset": "{step}"}
    steps(tree).insert(0, {"selector": [{"succeed": {}}, _set("step", {"xyz": [0, 0, 0.1]})]})
    yield Mistake("a key that was never written", tree, "NEVER_WRITTEN", ("step",))
    tree = shipped("reach_to_pose")
    late = {"sequence": [{"wait": {"seconds": 1}}, _set("step", {"xyz": [0, 0, 0.1]})]}
    both = [{"reach_to_pose": {"offset": "{step}"}}, late]
    tree["arms"]["arm1"]["tree"] = {"parallel": {"children": both}}
    yield Mistake("a key that is written too late", tree, "NEVER_WRITTEN", ("step", "set"))
    tree = shipped("reach_to_pose")
    compare = {"value": "{mode}", "relation": "equal", "to": "fast"}
    steps(tree).insert(0, _set("mode", "slow"))
    steps(tree).insert(1, {"compare": compare})
    yield Mistake("a comparison that does not hold", tree, "CONDITION", ("mode", "set"))


def _set(key: str, value: object) -> Tree:
    return {"set": {"key": key, "value": value}}


def of_time() -> Iterator[Mistake]:
    """Timeouts, time limits, arms that wait for each other."""
    for seconds in (0.2, 0.6):
        tree = shipped("reach_to_pose")
        child = steps(tree)[1]
        steps(tree)[1] = {"timeout": {"seconds": seconds, "child": child}}
        yield Mistake(f"a timeout of {seconds} s", tree, "TOO_LITTLE_TIME", ("reach_to_pose",))
    tree = shipped("reach_to_pose")
    tree["world"]["time_limit"] = 2.0
    yield Mistake("a time limit too short", tree, "TOO_LITTLE_TIME", ("reach_to_pose",))
    tree = shipped("pick_and_track")
    steps(tree).insert(0, {"wait": {"seconds": 500}})
    yield Mistake("an arm that waits too long", tree, "TOO_LITTLE_TIME", ("wait",), 8.0)
    for gap in (0.0, 0.05, 0.1):
        yield Mistake(f"arms that block each other, {gap} m", _crossing(gap), "OTHER_ARM", ())


def _crossing(gap: float) -> Tree:
    """Two arms, each of which has to reach a pose that the other one blocks."""
    arms = {}
    for name, side in (("left", 1), ("right", -1)):
        pose = {"xyz": [0.45, -side * (0.05 + gap) * 0.2, 0.3], "rpy": [180, 0, 0]}
        base = {"xyz": [0, side * 0.45, 0]}
        tree = {"sequence": [{"reach_to_pose": {"to": pose}}, {"wait": {"seconds": 100}}]}
        arms[name] = {"robot": "ur5", "base": base, "tree": tree}
    return {"bt_dualarm": 1, "name": "crossing", "world": {"scene": "empty"}, "arms": arms}


def of_leaves() -> Iterator[Mistake]:
    """Leaves with impossible ports, and leaves that exclude each other."""
    tree = shipped("circle")
    tree["params"] = {}
    both = [{"circle": {"plane": "yz", "radius": 0.05}}, {"go_home": {}}]
    tree["arms"]["arm1"]["tree"] = {"parallel": {"children": both}}
    yield Mistake("two leaves move one arm", tree, "BUSY", ("circle", "go_home"))
    tree = shipped("circle")
    tree["params"] = {}
    down = {"direction": [0, 0, 1], "distance": 0.05}
    tree["arms"]["arm1"]["tree"] = {"move_until_contact": down}
    yield Mistake("nothing to touch there", tree, "NOTHING_THERE", ("50 mm",))
    tree = shipped("pick_and_transport")
    steps(tree)[0] = {"approach_and_attach": {"object": "cube", "direction": [0, 0, 0]}}
    yield Mistake("a direction without length", tree, "INVALID_TARGET", ("zero vector",))
    tree = shipped("circle")
    tree["params"] = {}
    tree["objects"] = {"wall": box((0.02, 0.6, 0.6), (0.70, 0.1, 0.80))}
    tree["arms"]["arm1"]["force_limit"] = 10
    press = {"direction": [1, 0, 0], "distance": 0.2, "force": 40}
    tree["arms"]["arm1"]["tree"] = {"move_until_contact": press}
    yield Mistake("a force limit too low", tree, "LOW_FORCE_LIMIT", ("10 N",))


def of_messages() -> Iterator[Mistake]:
    """Messages of the author that hide a cause, and failures that follow from another one."""
    tree = shipped("circle")
    tree["params"] = {}
    fail = {"fail": {"code": "NO_WORK", "reason": "nothing to do today"}}
    tree["arms"]["arm1"]["tree"] = {"sequence": [{"go_home": {}}, fail]}
    yield Mistake("the author says so", tree, "SAID_SO", ("nothing to do today",))
    tree = shipped("pick_and_transport")
    bad = {"transport": {"object": "cube", "to": {"xyz": [0.3, -0.45, 0.65]}}}
    tree["arms"]["arm1"]["tree"] = {"selector": [bad, {"fail": {"code": "A", "reason": "no way"}}]}
    yield Mistake("a last word after the cause", tree, "NEVER_ATTACHED", ("cube",))
    tree = shipped("pick_and_transport")
    steps(tree)[0] = {"retry": {"times": 3, "child": {"detach": {"object": "cube"}}}}
    tree["objects"]["cube"]["spawned"] = False
    yield Mistake("a cube that is not there to be let go", tree, "NOT_SPAWNED_YET", ("cube",))
    tree = shipped("pick_and_track")
    steps(tree)[0] = {"approach_and_attach": {"object": "cube", "standoff": 0.10}}
    tree["objects"]["cube"]["pose"]["xyz"] = [0.60, -0.70, 0.425]
    tree["arms"]["arm1"]["base"]["xyz"] = [-0.45, 0, 0.4]
    tree["arms"]["arm2"]["tree"]["sequence"][1]["track"]["lost_timeout"] = 4
    yield Mistake("the other arm's pick failed first", tree, "OUT_OF_REACH", ("cube",), 15.0)
    tree = shipped("circle")
    tree["params"] = {}
    tree["objects"] = {"wall": box((0.02, 1.0, 0.8), (0.80, 0.1, 0.8), "white")}
    line = {"move_linear": {"offset": {"xyz": [0.20, 0, 0], "frame": "world"}}}
    tree["arms"]["arm1"]["tree"] = {"sequence": [line]}
    yield Mistake("a wall at the end of a line", tree, "IN_THE_WAY", ("wall",))
