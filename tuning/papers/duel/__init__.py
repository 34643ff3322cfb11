"""The two families of estimators against each other on the antagonistic joint."""
