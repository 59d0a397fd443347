"""Steps that a hand can follow: pivots, straight legs and doors along a route. Begin in `step_planner`."""
