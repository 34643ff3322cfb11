"""Recursive least squares in matrices, each recursion as its source prints it."""

import numpy as np


def plain(features, targets, prior):
    """(14) of Flacco et al., IROS 2011; return the coefficients after every sample and the last P."""
    coefficients, covariance, answers = np.zeros(features.shape[1]), prior * np.eye(features.shape[1]), []
    for row, target in zip(features, targets, strict=True):
        gain = covariance @ row / (1 + row @ covariance @ row)
        coefficients = coefficients + gain * (target - row @ coefficients)
        covariance = covariance - np.outer(gain, row @ covariance)
        answers.append(coefficients)
    return np.array(answers), covariance


def with_factor(features, targets, prior, factor):
    """(25) of Flacco et al., IROS 2011, with the stability factor a = factor(ρ); also return every a."""
    coefficients, covariance = np.zeros(features.shape[1]), prior * np.eye(features.shape[1])
    answers, factors = [], []
    for row, target in zip(features, targets, strict=True):
        leverage = row @ covariance @ row
        step = factor(leverage) * (covariance @ row) / (1 + leverage)
        coefficients = coefficients + step * (target - row @ coefficients)
        covariance = covariance - np.outer(step, row @ covariance)
        answers.append(coefficients)
        factors.append(factor(leverage))
    return np.array(answers), np.array(factors)


def enhanced(features, targets, prior, constant):
    """(25) with a(k) = (c + cρ)/(1 + cρ), (27)."""
    return with_factor(features, targets, prior, lambda rho: (constant + constant * rho) / (1 + constant * rho))


def forgetting(features, targets, prior, memory):
    """Forgetting λ towards the prior, in information form; return coefficients, the last P, innovations e.

    What is forgotten of the data is given back to the prior of one coefficient after the other, d-fold.
    """
    size = features.shape[1]
    information, coefficients, answers, innovations = np.eye(size) / prior, np.zeros(size), [], []
    for k, (row, target) in enumerate(zip(features, targets, strict=True)):
        information = memory * information
        information[k % size, k % size] += (1.0 - memory) * size / prior
        error = target - row @ coefficients
        innovations.append(error / np.sqrt(1.0 + row @ np.linalg.solve(information, row)))
        information = information + np.outer(row, row)
        coefficients = coefficients + np.linalg.solve(information, row) * error
        answers.append(coefficients)
    return np.array(answers), np.linalg.inv(information), np.array(innovations)


def ridge(features, targets, prior, weights=1.0):
    """Return argmin Σ w (y − Fᵀη)² + ηᵀη/κ and the minimum, by QR of the augmented system."""
    root = np.sqrt(np.broadcast_to(weights, targets.shape))
    size = features.shape[1]
    matrix = np.vstack([root[:, None] * features, np.eye(size) / np.sqrt(prior)])
    right = np.concatenate([root * targets, np.zeros(size)])
    solution = np.linalg.lstsq(matrix, right)[0]
    return solution, np.sum((matrix @ solution - right) ** 2)
