"""How good an answer is, accumulated sample by sample: of estimates, and of joints that come to rest."""

from vsajax.scores.estimates import Scorer, Scores
from vsajax.scores.swings import Swept, SwingScorer, SwingScores

__all__ = ["Scorer", "Scores", "Swept", "SwingScorer", "SwingScores"]
