"""What pages ask of a record, whole or still being written; the page on a record that is over."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bt_dualarm.live.answers import Answer, Asked, Query, ViewError, number_in, text_in
from bt_dualarm.live.past import Past
from bt_dualarm.live.past_series import log_of, series_of, why_of
from bt_dualarm.live.pictures import PastPictures
from bt_dualarm.live.signals import series_text
from bt_dualarm.recording.history_file import HistoryError
from bt_dualarm.replay.record import ReplayError
from bt_dualarm.replay.story import stories
from bt_dualarm.replay.story_text import state_of
from bt_dualarm.spec.source import Json


class PastAnswers:
    """Answers on the past of a run.

    Args:
        folder: Folder of the record.
    """

    def __init__(self, folder: Path) -> None:
        self.past = Past(folder)
        self._pictures = PastPictures(self.past)

    @property
    def questions(self) -> Mapping[str, Asked]:
        """What may be asked, by name; each raises `ReplayError` where there is no past yet."""
        return {
            "at": lambda query: Answer.of(self.past.moment(number_in(query, "t"))),
            "series": lambda _: Answer.of(self._series()),
            "why": self._why,
            "eye": self._eye,
        }

    def scene(self, generation: int) -> Json:
        """Shapes of a model of the record, and the names of its meshes."""
        looks = self.past.looks(generation)
        return {"generation": generation, "shapes": [*looks.shapes], "meshes": [*looks.meshes]}

    def _series(self) -> Json:
        """Nothing of a run that has hardly begun."""
        try:
            return series_of(self.past.record)
        except (ReplayError, HistoryError):
            return series_text({})

    def _why(self, query: Query) -> Answer:
        asked = query.get("of")
        time = number_in(query, "t") if "t" in query else None
        of = None if asked is None else text_in(query, "of")
        return Answer.of(why_of(self.past.record, of, time))

    def _eye(self, query: Query) -> Answer:
        return Answer.jpeg(self._pictures.jpeg(text_in(query, "arm"), number_in(query, "t")))


class RecordView:
    """The page on a record: all of its times, and no button that would do anything.

    Args:
        folder: Folder of the record.

    Raises:
        ReplayError: There is no record.
    """

    def __init__(self, folder: Path) -> None:
        self._answers = PastAnswers(folder)
        self.past = self._answers.past
        self.past.moment(0.0)

    @property
    def questions(self) -> Mapping[str, Asked]:
        """What may be asked, by name."""
        return {
            **self._answers.questions,
            "": lambda _: Answer.page(),
            "now": lambda _: Answer.of(self._now()),
            "log": lambda _: Answer.of(log_of(self.past.record)),
            "scene": self._scene,
            "mesh": lambda query: Answer.numbers(self.past.mesh(text_in(query, "name"))),
        }

    def do(self, asked: Json) -> Json:
        """Nothing can be done to what is over.

        Raises:
            ViewError: Always.
        """
        raise ViewError(f"a record is only looked at: {str(asked.get('deed'))[:40]!r} does nothing")

    def _now(self) -> Json:
        record = self.past.record
        until = round(record.until, 4)
        ends = [story.ended_s for story in stories(record) if story.ended_s is not None]
        begin = round(min(ends, default=0.0), 4)
        told = {"kind": "record", "name": record.name, "until": until, "begin": begin}
        return {**told, "facts": state_of(record), "recorded": True}

    def _scene(self, query: Query) -> Answer:
        return Answer.of(self._answers.scene(int(number_in(query, "generation"))))
