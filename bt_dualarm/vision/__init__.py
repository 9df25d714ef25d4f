"""bt_dualarm.vision."""
