"""The lab: studies, sweeps, tuning, reproduction and export; it uses vsajax' public names only."""
