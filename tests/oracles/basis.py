"""The regressors (18)–(23) of Flacco et al., IROS 2011."""

import numpy as np


def separable(deflection, setpoint, deflection_terms=6, setpoint_terms=3):
    """Return F and ∂F/∂φ, one row a sample: s^j φ^(2i+1), j outer, i inner."""
    pairs = [(j, 2 * i + 1) for j in range(setpoint_terms) for i in range(deflection_terms)]
    features = np.stack([setpoint**j * deflection**e for j, e in pairs], axis=-1)
    return features, np.stack([setpoint**j * e * deflection ** (e - 1) for j, e in pairs], axis=-1)
