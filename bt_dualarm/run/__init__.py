"""bt_dualarm.run."""
