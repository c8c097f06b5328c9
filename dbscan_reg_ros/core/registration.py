"""The registration of one scan onto another (Figure 13)."""
from .parameters import Parameters
from .records import Features, Prior, Registration


def register(reference: Features, current: Features, parameters: Parameters = Parameters(),
             prior: Prior | None = None) -> Registration:
    raise NotImplementedError
