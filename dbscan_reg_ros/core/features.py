"""Everything that is kept of one scan, computed once."""
import numpy as np

from .parameters import Parameters
from .records import Features, Segments
from .scan import Scan


def extract_features(scan: Scan, parameters: Parameters = Parameters()) -> Features:
    raise NotImplementedError
