"""Other ways to the diffuse colour, on the frames and texels of one of our results.

Each peer is a function `run(capture, truth, folder) -> Scores` that leaves what our own results
hold: `maps/diffuse.exr` (linear, 1 = 255, NaN where unseen) and `maps/valid.png`; and `views/`
where it renders by itself.
"""

from .scores import PEERS, peer_scores

__all__ = ["PEERS", "peer_scores"]
