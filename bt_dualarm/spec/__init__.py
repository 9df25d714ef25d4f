"""bt_dualarm.spec."""
