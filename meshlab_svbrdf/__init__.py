"""How an object reflects light, recovered from an ordinary video of it, as MeshLab filters."""

__version__ = "0.1.0"
