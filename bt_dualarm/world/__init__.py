"""bt_dualarm.world."""
