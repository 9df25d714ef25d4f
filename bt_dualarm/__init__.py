"""bt_dualarm."""
