"""Records of runs, read again: what went wrong and why, whether a run repeats, films and tables.

In: the folder of a record, whole or left behind by a process that was killed.
Out: a `Record`; the story of a failure.
Open first: `record` (all that a record holds), `story` (why a leaf failed); others: `timeline`
(what became of each node), `decisive` (the leaf that decided), `evidence`, `causes` (by topic:
`board_causes`, `world_causes`, `grip_causes`, `contact_causes`, `camera_causes`, `sight_causes`,
`reach_causes`, `time_causes`),
`scene` (the world at a time), `before` (the second before), `story_text`; `check` (does a run
repeat?) and `resume` (go on from a time), which make it anew (`rerun`, `past`,
`known_pictures`); `mcap_export` (with `message`, `messages`,
`scene_messages`, `drawn_shapes`, `camera_messages`, `message_schemas`), `kept_pictures`, `video`
(with `film_scene`, `film_camera`, `film_panel`, `film_style`), `lerobot_export` (with
`lerobot_episode`, `lerobot_tables`) and `tables` (exports); `arm_parts` (joints and gripper of an
arm in a model).
"""
