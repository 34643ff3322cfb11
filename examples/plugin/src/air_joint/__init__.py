"""A pneumatic joint for vsajax: studies name what is in `tables`; what is in `modules` runs."""
