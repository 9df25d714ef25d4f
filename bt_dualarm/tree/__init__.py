"""bt_dualarm.tree."""
