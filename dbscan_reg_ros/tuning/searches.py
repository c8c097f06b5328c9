# SPDX-License-Identifier: Apache-2.0
"""Search strategies: ``ask(count)`` returns values to try, ``tell(costs)`` receives their costs in the same order."""
import numpy as np


class RandomSearch:
    """Random search: draws values from a uniform distribution, independently of the costs of earlier trials."""

    def __init__(self, axes, seed):
        self._axes, self._seed, self._asked = axes, seed, 0

    def ask(self, count):
        """Return `count` dictionaries of parameter name -> value to try."""
        numbers = range(self._asked, self._asked + count)
        self._asked += count
        return [{axis.name: axis.at(share) for axis, share in
                 zip(self._axes, np.random.default_rng((self._seed, number)).random(len(self._axes)), strict=True)}
                for number in numbers]

    def tell(self, costs):
        """Receive the costs of the values that the last `ask` returned; lower is better."""


class OptunaSearch:
    """Search with Optuna's tree-structured Parzen estimator."""

    def __init__(self, axes, seed):
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._axes, self._pending = axes, []
        self._study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed, constant_liar=True))

    def ask(self, count):
        """Return `count` dictionaries of parameter name -> value to try."""
        self._pending = [self._study.ask() for _ in range(count)]
        return [{axis.name: axis.at(trial.suggest_float(axis.name, 0.0, 1.0)) for axis in self._axes}
                for trial in self._pending]

    def tell(self, costs):
        """Receive the costs of the values that the last `ask` returned; lower is better."""
        for trial, cost in zip(self._pending, costs, strict=True):
            self._study.tell(trial, cost)


def has_optuna() -> bool:
    """Whether Optuna is installed."""
    import importlib.util
    return importlib.util.find_spec('optuna') is not None
