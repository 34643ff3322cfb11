"""Better numbers: by gradient, by grid, by trials, and the contest of estimators."""
