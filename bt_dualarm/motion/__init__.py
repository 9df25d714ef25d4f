"""bt_dualarm.motion."""
