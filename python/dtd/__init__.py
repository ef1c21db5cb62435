"""Opens a corpus that `dtd` recorded: its tables as data frames, its images as arrays, its cameras.

    from dtd import Corpus

    corpus = Corpus("corpus")
    corpus.ticks()                                    # one row per scenario and tick, with the distance to touchdown
    corpus.frame("1200-clear-r1", "left", tick=40)    # height x width x 3, RGB

docs/dataset.md of the dtd repository describes every column: type, unit, axes.
"""

from dtd.camera import Camera
from dtd.corpus import Corpus
from dtd.files import CorpusError
from dtd.video import Video

__all__ = ["Camera", "Corpus", "CorpusError", "Video"]
