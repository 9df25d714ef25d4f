"""What other libraries of behaviour trees call the words of this language."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final

from bt_dualarm.spec.problems import suggestion

SYNONYMS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "Fallback": "selector",
        "ReactiveFallback": "selector, with memory: false",
        "ReactiveSequence": "sequence, with memory: false",
        "SequenceWithMemory": "sequence",
        "ParallelAll": "parallel, with policy: all",
        "IfThenElse": "if",
        "Switch2": "switch",
        "Switch3": "switch",
        "EternalGuard": "guard",
        "RetryUntilSuccessful": "retry, with times",
        "KeepRunningUntilFailure": "repeat, with times: forever",
        "OneShot": "run_once",
        "SuccessIsFailure": "force_failure",
        "FailureIsSuccess": "force_success",
        "AlwaysSuccess": "succeed",
        "AlwaysFailure": "fail",
        "Success": "succeed",
        "Failure": "fail",
        "Sleep": "wait, with seconds",
        "Timer": "wait, with seconds",
        "SetBlackboard": "set",
        "ScriptCondition": "compare",
    }
)
"""Names of BehaviorTree.CPP and py_trees where they are not ours in another case; our words."""

_OWN_SKILLS: Final = "(skills of your own: --skills DIR)"


def kind_hint(given: str, kinds: Iterable[str]) -> str:
    """A hint for an unknown kind of node: our word for it, the nearest one, or all of them."""
    known = {_letters(kind): kind for kind in kinds}
    ours = {_letters(name): word for name, word in SYNONYMS.items()} | known
    word = ours.get(_letters(given), "")
    if word:
        name, comma, how = word.partition(",")
        return f"here it is '{name}'{comma}{how}"
    return f"{suggestion(given, known.values(), 'kind of node')} {_OWN_SKILLS}"


def _letters(name: str) -> str:
    """A name as it is compared: without case and underscores."""
    return re.sub("[^a-z0-9]", "", name.lower())
