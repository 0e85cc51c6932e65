"""Learning algorithms: pure functions init, act and update on pytrees."""
