"""omni-mj: a MuJoCo testbed for the motion control of RoboCup Small Size League robots."""
