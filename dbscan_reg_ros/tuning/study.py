# SPDX-License-Identifier: Apache-2.0
"""Parameter search whose trials are stored, so that it can be killed at any time and continued."""
import json
import os
from operator import itemgetter

import numpy as np

from ..core.errors import ParameterError

BATCH = 8
"""Number of trials chosen at a time; fixed, so that the result does not depend on the number of processes."""


class Study:
    """Trials of a search, stored in a folder: settings.json, and trials.jsonl with a line for each trial.

    Parameters
    ----------
    folder : Path
        Folder of the search: created if it does not exist, continued if it contains trials with the same settings.
    settings : dict
        Settings that determine the result: ``search``, ``seed``, ``start`` (name -> value of the first trial), and
        others.
    axes : list of Axis

    Raises
    ------
    ParameterError
        When the folder contains trials with other settings.
    """

    def __init__(self, folder, settings, axes):
        self._settings, self._axes, self._file = settings, axes, folder / 'trials.jsonl'
        folder.mkdir(parents=True, exist_ok=True)
        kept = folder / 'settings.json'
        if kept.exists() and json.loads(kept.read_text()) != json.loads(json.dumps(settings)):
            raise ParameterError(f'{folder}: holds a search with other settings; choose another folder, or remove it')
        unfinished = kept.with_suffix('.part')
        unfinished.write_text(json.dumps(settings, indent=1) + '\n')
        os.replace(unfinished, kept)
        self._known = self._read()
        self.cost_of_start = None

    def run(self, trials, evaluate, watch):
        """Run trials until a given number is stored; return (cost, values) of the best trial.

        `evaluate` maps trial number -> values, and yields (number, cost) as each trial finishes; ``watch(done, best
        cost)`` is called after each.
        """
        search = SEARCHES[self._settings['search']](self._axes, self._settings['seed'])
        best, done = None, 0
        while done < trials:
            count = min(BATCH, trials - done)
            first = [] if done else [self._settings['start']]
            asked = [*first, *search.ask(count - len(first))]
            numbered = dict(enumerate(asked, done))
            new = {number: values for number, values in numbered.items() if number not in self._known}
            for _ in self._evaluated(new, evaluate):
                costs = self._costs(numbered)
                watch(done + len(costs), min(costs if best is None else [*costs, best[0]]))
            costs = self._costs(numbered)
            search.tell(costs[len(first):])
            self.cost_of_start = self._known[0]
            tried = [*zip(costs, asked, strict=True)]
            best = min(tried if best is None else [best, *tried], key=itemgetter(0))
            done += count
            watch(done, best[0])
        return best

    def _evaluated(self, trials, evaluate):
        """Yield the cost of each of the `trials` (number -> values) once it is stored."""
        for number, cost in evaluate(trials) if trials else ():
            self._known[number] = cost
            self._append(number, trials[number], cost)
            yield cost

    def _costs(self, numbers):
        """Return the costs of the stored trials among these `numbers`, in the order of `numbers`."""
        return [self._known[number] for number in numbers if number in self._known]

    @property
    def known(self) -> int:
        """Number of stored trials."""
        return len(self._known)

    def _read(self):
        """Read the stored trials, number -> cost; drop an incomplete last line of a killed search."""
        known, whole = {}, 0
        for line in self._file.read_text().splitlines(keepends=True) if self._file.exists() else ():
            if not line.endswith('\n'):
                break
            trial = json.loads(line)
            known[trial['number']] = trial['cost']
            whole += len(line)
        if self._file.exists():
            os.truncate(self._file, whole)
        return known

    def _append(self, number, values, cost):
        with open(self._file, 'a', encoding='utf-8') as file:
            file.write(json.dumps({'number': number, 'cost': cost, 'values': values}) + '\n')
            file.flush()
            os.fsync(file.fileno())


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


SEARCHES = {'random': RandomSearch, 'optuna': OptunaSearch}
