# SPDX-License-Identifier: Apache-2.0
"""Accessibility of the page: axe-core finds no violation of level A or AA, and colours have enough contrast."""
import base64
import hashlib
import io
import json
import os
import pathlib
import shutil
import subprocess
import tarfile

import numpy as np
import pytest

from dbscan_reg_ros.figures.plots import density_map
from dbscan_reg_ros.replays.live.server import live_page
from dbscan_reg_ros.replays.page.entries import COMPARISON_COLUMNS, REPLAY_COLUMNS
from dbscan_reg_ros.replays.page.index import DriveEntry, small_map, write_index

AXE = 'axe-core-4.10.3'
SHA512 = 'Xm7bpRXnDSX2YE2YFfBk2FnF0ep6tmG7xPh8iHee8MIcrgq762Nkce856dYtJYLkuIoYZvGfTs/PbZhideTcEg=='
"""Of the package that npm downloads (MPL-2.0): kept in the user's cache, no part of this project."""
LEVELS = ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa']
DRAWN = ('line', 'density', 'trajectory', 'bad', 'truth', 'wheels', 'scan', 'segments', 'covariance', 'keyframes',
         'loops', 'marks', 'chosen', 'ink', 'muted', 'other0', 'other1', 'other2', 'other3', 'other4')
# Machado, Oliveira and Fernandes 2009, severity 1.0, on linear RGB.
EYES = {
    'all cones': np.eye(3),
    'protanopia': np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                            [-0.003882, -0.048116, 1.051998]]),
    'deuteranopia': np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                              [-0.011820, 0.042940, 0.968881]]),
    'tritanopia': np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                            [0.004733, 0.691367, 0.303900]]),
}


@pytest.fixture(scope='session')
def axe():
    """The script of axe-core, downloaded once."""
    cache = pathlib.Path(os.environ.get('XDG_CACHE_HOME') or pathlib.Path.home() / '.cache') / 'dbscan_reg_ros'
    package = cache / f'{AXE}.tgz'
    if not package.exists():
        if shutil.which('npm') is None:
            pytest.skip('needs npm, which downloads axe-core')
        cache.mkdir(parents=True, exist_ok=True)
        done = subprocess.run(['npm', 'pack', '--silent', AXE.replace('core-', 'core@')], cwd=cache,
                              capture_output=True, text=True, timeout=120, check=False)
        if done.returncode:
            pytest.skip(f'axe-core cannot be downloaded: {done.stderr.strip()[:200]}')
    content = package.read_bytes()
    assert base64.b64encode(hashlib.sha512(content).digest()).decode() == SHA512
    with tarfile.open(fileobj=io.BytesIO(content)) as files:
        return files.extractfile('package/axe.min.js').read().decode()


def violations(browser, axe):
    """What axe-core finds on the page, with all details open, and if it has run few rules."""
    browser.value('for (const details of document.querySelectorAll("details")) details.open = true')
    browser.value(f'{axe}; 0')
    return browser.value(f'axe.run({{runOnly: {json.dumps(LEVELS)}}}).then(result => result.violations.map('
                         'each => [each.id, each.help, each.nodes.map(node => node.html.slice(0, 150))])'
                         '.concat(result.passes.length > 10 ? [] : ["too few rules ran"]))')


@pytest.mark.parametrize('dark', [False, True])
@pytest.mark.parametrize('screen', [(390, 844), (1400, 900)])
def test_axe_finds_no_violation_of_level_a_or_aa(show, page, known, axe, screen, dark):
    browser = show(page(known, closed=True), *screen, dark)
    assert violations(browser, axe) == []
    browser.value('page.choose(1)')
    browser.frame()
    assert violations(browser, axe) == []


@pytest.mark.parametrize(('columns', 'rows'), [
    (COMPARISON_COLUMNS, [['A: ours', *'?' * 11], ['B: theirs', *'?' * 11]]), (REPLAY_COLUMNS, [['?'] * 7])])
def test_axe_finds_no_violation_in_an_index(browser, axe, tmp_path, columns, rows):
    entry = DriveEntry('drive', 'drive/report.html', rows, small_map(density_map([], []), []), ['A: a note'])
    write_index(tmp_path / 'index.html', 'drives', columns, [entry])
    for screen in (390, 844, True), (1400, 900, False):
        browser.screen(*screen)
        browser.open((tmp_path / 'index.html').as_uri())
        assert violations(browser, axe) == []


@pytest.mark.parametrize('dark', [False, True])
@pytest.mark.parametrize('screen', [(390, 844), (1400, 900)])
def test_axe_finds_no_violation_in_the_live_page(browser, axe, tmp_path, screen, dark):
    path = tmp_path / 'live.html'
    # Without a server there is nothing to connect to.
    path.write_text(live_page('/scan').decode().replace("new EventSource('events' + location.search)",
                                                        'new EventTarget()'))
    browser.screen(*screen, dark)
    browser.open(path.as_uri())
    browser.value('ready.then(() => 0)')
    for k in range(3):
        browser.value(f'page.add({{time: {k}, pose: [{k}, 0, 0], sigma: [0.1, 0.05, 0, 0.01], status: {k % 2}, '
                      'reason: "tracking", speed: 0.5, points: btoa("\\x01\\x00\\x02\\x00")})')
    browser.frame()
    assert violations(browser, axe) == [] and browser.complaints == []


def linear(colour):
    """A colour as linear RGB, 0..1."""
    values = np.array([int(colour[k:k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def contrast(first, second, eye):
    """Contrast of two colours (WCAG 2.2) as an eye sees them."""
    seen = [np.clip(eye @ linear(colour), 0.0, 1.0) for colour in (first, second)]
    low, high = sorted(float(colour @ (0.2126, 0.7152, 0.0722)) for colour in seen)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize('dark', [False, True])
def test_drawn_colours_have_a_contrast_of_3_for_every_kind_of_eye(show, page, dark):
    browser = show(page(), dark=dark)
    names = json.dumps([*DRAWN, 'paper', 'panel'])
    found = browser.value('(style => ' + names + '.map(name => style.getPropertyValue("--" + name).trim()))'
                          '(getComputedStyle(document.documentElement))')
    colours = dict(zip([*DRAWN, 'paper', 'panel'], found, strict=True))
    low = {(name, ground, kind): round(value, 2)
           for name in DRAWN for ground in ('paper', 'panel') for kind, eye in EYES.items()
           if (value := contrast(colours[name], colours[ground], eye)) < 3.0}
    assert low == {}


def test_what_differs_in_colour_differs_in_shape_as_well(show, page, known):
    """No two lines or markers of the layers have the same dashes and form."""
    browser = show(page(known, closed=True))
    shapes = browser.value('[...document.querySelectorAll("#layers .key path")].map(path => '
                           '["d", "stroke-dasharray", "stroke-linecap"].map(name => path.getAttribute(name)).join())')
    assert len(set(shapes)) == 9
    lines = browser.value('["trajectory", "truth", "wheels"].map(name => DASHES[name].join())')
    assert len(set(lines)) == 3


@pytest.mark.parametrize(('width', 'height'), [(390, 844), (1400, 900)])
def test_every_control_is_large_enough_for_a_finger(show, page, known, width, height):
    browser = show(page(known, closed=True), width, height)
    browser.value('page.choose(0)')
    browser.frame()
    controls = '"button, select, input[type=range], #layers label, summary"'
    small = browser.value(f'[...document.querySelectorAll({controls})]' '''
        .filter(each => each.offsetParent !== null)
        .map(each => [each.id || each.textContent, each.getBoundingClientRect()])
        .filter(([, box]) => Math.min(box.width, box.height) < 24).map(([name]) => name)''')
    assert small == []
