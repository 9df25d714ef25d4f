"""Pictures of a record, and what was found in them: who goes on from it need not draw them."""

from __future__ import annotations

from collections import defaultdict

from bt_dualarm.replay.record import Record
from bt_dualarm.runtime.sights import KnownPicture
from bt_dualarm.world.cameras.frame import Plain


def known_pictures(record: Record, until: float) -> dict[str, dict[float, KnownPicture]]:
    """Pictures that were taken before a time in s, by arm and stamp.

    Those of records that say too little of a picture are left out.
    """
    answers: dict[tuple[str, float], dict[str, Plain]] = defaultdict(dict)
    for note in record.notes:
        if note["kind"] == "found":
            answers[note["arm"], note["stamp"]][note["asked"]] = note["answer"]
    found: dict[str, dict[float, KnownPicture]] = defaultdict(dict)
    for note in record.notes:
        if note["kind"] == "frame" and "stride" in note and note["time_s"] < until:
            left, top, right, bottom = note["region"]
            arm, stamp = note["arm"], note["stamp"]
            found[arm][stamp] = KnownPicture(
                (left, top, right, bottom), note["stride"], note["crc"], answers[arm, stamp]
            )
    return found
