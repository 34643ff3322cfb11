"""Every pose of a seven-joint arm that has its hand at a place, in closed form: the oracle of the search of poses.

For arms with spherical shoulder and wrist and the hand on the last axis, as `lwr-like-7`. Then the last joint does
not move the hand, and what is left of its self-motion has three dimensions: the direction from the wrist to the
hand (two) and the turn of the elbow about the line from shoulder to wrist (one). Angles are not needed: the
Jacobian's columns follow from where shoulder, elbow, wrist and hand are.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

Points = np.ndarray
"""Vectors [m], `(many, 3)`."""


class Lengths(NamedTuple):
    """Of the arm [m].

    Args:
        shoulder: height of the shoulder on the first axis.
        upper: from the shoulder to the elbow.
        lower: from the elbow to the wrist.
        hand: from the wrist to the hand.
    """

    shoulder: float
    upper: float
    lower: float
    hand: float


def scan(lengths: Lengths, hand: np.ndarray, bend: float, directions: int, turns: int) -> np.ndarray:
    """Return the position Jacobians of all poses on an even grid of the self-motion, `(poses, 3, 7)` [m].

    Args:
        lengths: of the arm.
        hand: where it is [m].
        bend: largest angle of joints 2, 4 and 6 to either side [rad]. The ranges of the other joints leave nothing
            out as long as they reach 90° to either side: a joint's angle changes by 180° when that of its
            neighbour changes sign, with the same pose.
        directions: of the hand, on a spiral over the sphere.
        turns: of the elbow.
    """
    shoulder, approach = np.array([0.0, 0.0, lengths.shoulder]), _sphere(directions)
    wrist = hand - lengths.hand * approach
    span = wrist - shoulder
    distance = np.linalg.norm(span, axis=1)
    near = (distance > abs(lengths.upper - lengths.lower)) & (distance < lengths.upper + lengths.lower)
    approach, wrist, span, distance = approach[near], wrist[near], span[near], distance[near]
    line = span / distance[:, None]
    along = (distance**2 + lengths.upper**2 - lengths.lower**2) / (2.0 * distance)
    aside = np.sqrt(lengths.upper**2 - along**2)
    across = _unit(np.cross(line, np.eye(3)[np.abs(line).argmin(1)]))
    angles = 2.0 * np.pi * (np.arange(turns) + 0.5) / turns
    around = np.cos(angles)[:, None, None] * across + np.sin(angles)[:, None, None] * np.cross(line, across)
    elbow = shoulder + (along[:, None] * line + aside[:, None] * around)
    elbow, wrist, approach = (np.broadcast_to(p, elbow.shape).reshape(-1, 3) for p in (elbow, wrist, approach))
    return _jacobians(shoulder, elbow, wrist, approach, hand, bend)


def _jacobians(
    shoulder: np.ndarray, elbow: Points, wrist: Points, approach: Points, hand: np.ndarray, bend: float
) -> np.ndarray:
    up = np.broadcast_to([0.0, 0.0, 1.0], elbow.shape)
    links = [up, _unit(elbow - shoulder), _unit(wrist - elbow), approach]
    least = np.cos(bend)
    allowed = np.all([(a * b).sum(1) >= least for a, b in itertools.pairwise(links)], axis=0)
    tilts = [_unit(np.cross(a, b)) for a, b in itertools.pairwise(links)]
    turned = [(links[0], shoulder), (tilts[0], shoulder), (links[1], shoulder), (tilts[1], elbow)]
    turned += [(links[2], wrist), (tilts[2], wrist), (links[3], hand)]
    columns = [np.cross(axis, hand - place) for axis, place in turned]
    return np.stack(columns, axis=2)[allowed]


def _sphere(count: int) -> Points:
    """Return directions on Fibonacci's spiral."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def _unit(vectors: Points) -> Points:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
