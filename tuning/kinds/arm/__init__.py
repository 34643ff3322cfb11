"""The Cartesian stiffness of arms: studies of kind "arm", and what the lab does with them."""
