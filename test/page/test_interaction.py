# SPDX-License-Identifier: Apache-2.0
"""The page by mouse, touch and keyboard: map, slider, plots, pairs, layers, closed map."""
import numpy as np
import pytest

NARROW = 390, 844
WIDE = 1400, 900


def box(browser, selector):
    """Left, top, width and height of an element on the screen."""
    return browser.value(f'''(() => {{ const box = document.querySelector({selector!r}).getBoundingClientRect();
        return [box.left, box.top, box.width, box.height]; }})()''')


def until(browser, condition):
    """Wait until a condition of the page is true."""
    browser.value('new Promise(done => { const look = () => '
                  f'{condition} ? done(0) : requestAnimationFrame(look); look(); }})')


def view(browser):
    """Centre [m] and scale [pixels/m] of the map."""
    browser.frame()
    return np.array(browser.value('[...page.view.centre, page.view.scale]'))


def colours(browser, canvas, name):
    """Number of pixels of a canvas in the colour of a layer."""
    return browser.value(f'''(() => {{
        const canvas = document.getElementById({canvas!r}), probe = document.createElement('canvas').getContext('2d');
        probe.fillStyle = page.view.colours[{name!r}];
        probe.fillRect(0, 0, 1, 1);
        const [r, g, b] = probe.getImageData(0, 0, 1, 1).data;
        const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
        let count = 0;
        for (let i = 0; i < pixels.length; i += 4)
            count += pixels[i] === r && pixels[i + 1] === g && pixels[i + 2] === b && pixels[i + 3] === 255;
        return count;
    }})()''')


def test_the_map_is_moved_and_zoomed_with_the_mouse(show, page):
    browser = show(page(), *WIDE)
    left, top, width, height = box(browser, '#view')
    x, y = round(left + 0.3 * width), round(top + 0.4 * height)
    before = view(browser)
    browser.mouse('mousePressed', x, y)
    browser.mouse('mouseMoved', x + 50, y + 20)
    browser.mouse('mouseReleased', x + 50, y + 20)
    after = view(browser)
    np.testing.assert_allclose(after - before, (-50 / before[2], 20 / before[2], 0.0), atol=1e-9)
    place = f'page.view.toMetres({x - left - 1}, {y - top - 1})'
    under = browser.value(place)
    browser.mouse('mouseWheel', x, y, deltaX=0, deltaY=-300)
    until(browser, f'page.view.scale > {1.2 * after[2]}')
    np.testing.assert_allclose(browser.value(place), under, atol=1e-6)
    browser.click('#all')
    np.testing.assert_allclose(view(browser), before, rtol=1e-9)


def test_the_map_is_moved_and_zoomed_with_fingers(show, page):
    browser = show(page(), *NARROW)
    browser.value('document.getElementById("view").scrollIntoView()')
    left, top, width, height = box(browser, '#view')
    x, y = left + 0.5 * width, top + 0.5 * height
    before = view(browser)
    browser.touch('touchStart', (x, y))
    for step in (10, 20, 30):
        browser.touch('touchMove', (x + step, y))
    browser.touch('touchEnd')
    moved = view(browser)
    assert moved[0] < before[0] and moved[2] == before[2] and moved[1] == before[1]
    browser.touch('touchStart', (x - 40, y), (x + 40, y))
    for spread in (60, 80):
        browser.touch('touchMove', (x - spread, y), (x + spread, y))
    browser.touch('touchEnd')
    assert view(browser)[2] == pytest.approx(2.0 * moved[2], rel=0.01)
    assert browser.value('window.scrollX') == 0 and browser.value('page.chosen') == -1


def test_the_map_is_moved_and_zoomed_with_keys(show, page):
    browser = show(page(), *WIDE)
    browser.value('document.getElementById("view").focus()')
    before = view(browser)
    for key, change in (('ArrowRight', (1, 0)), ('ArrowLeft', (-1, 0)), ('ArrowUp', (0, 1)), ('ArrowDown', (0, -1))):
        start = view(browser)
        browser.press(key)
        np.testing.assert_array_equal(np.sign((view(browser) - start).round(9)[:2]), change)
    browser.press('+')
    assert view(browser)[2] == pytest.approx(1.4 * before[2])
    browser.press('0')
    np.testing.assert_allclose(view(browser), before)


def test_map_plots_and_texts_follow_the_slider(show, page, known):
    browser = show(page(known), *WIDE)
    cursors = 'page.plots.map(plot => Number(plot.cursor.getAttribute("x1")))'
    start = browser.value(cursors)
    browser.value('document.getElementById("slider").focus()')
    for _ in range(3):
        browser.press('ArrowRight')
    browser.frame()
    assert browser.value('page.current') == 3
    for text in ('document.getElementById("now").textContent', 'document.getElementById("slider").ariaValueText'):
        assert browser.value(text).startswith('Scan 3, 0.3 s, ') and browser.value(text).endswith(' m: OK.')
    browser.value('page.go(90)')
    browser.frame()
    assert 'failed' in browser.value('document.getElementById("now").textContent')
    assert all(np.array(browser.value(cursors)) > np.array(start) + 100)
    values = dict(browser.value('[...document.querySelectorAll("#values dt")].map('
                                'dt => [dt.textContent, dt.nextSibling.textContent])'))
    assert list(values) == ['scan', 'pose', 'sigma', 'status', 'reason', 'registered to', 'translation error',
                            'rotation error', 'processing time']
    assert values['scan'] == '90' and values['status'] == 'failed' and values['processing time'].endswith(' ms')
    assert browser.complaints == []


def test_a_click_on_a_plot_moves_the_slider_and_dragging_goes_on(show, page, known):
    browser = show(page(known), *WIDE)
    browser.value('document.getElementById("plot-translation").scrollIntoView({block: "center"})')
    left, top, _, height = box(browser, '#plot-translation svg')
    x = browser.value('page.plots[0].chart.x(drive.along[50])')
    browser.mouse('mousePressed', left + x, top + height / 3)
    browser.frame()
    assert browser.value('document.getElementById("slider").value') == '50'
    browser.mouse('mouseMoved', left + browser.value('page.plots[0].chart.x(drive.along[70])'), top + height / 3)
    browser.mouse('mouseReleased', left + x, top + height / 3)
    browser.frame()
    assert browser.value('page.current') == 70


def test_the_drive_is_played_paused_and_ends(show, page):
    browser = show(page(), *WIDE)
    browser.value('document.getElementById("play").focus()')
    browser.press(' ')
    until(browser, 'page.current > 2')
    browser.press(' ')
    browser.frame()
    assert browser.value('[page.playing, document.getElementById("play").textContent]') == [0, 'Play']
    browser.value('document.getElementById("speed").value = 256')
    browser.click('#play')
    until(browser, 'page.current === 99 && !page.playing')
    browser.click('#play')
    until(browser, 'page.current === 99 && !page.playing')


def test_every_mark_is_reached_by_taps_on_a_narrow_map_and_its_pair_is_seen_without_scrolling(show, page):
    browser = show(page(), *NARROW)
    count = browser.value('page.marks.length')
    for index in range(count):
        browser.value('document.getElementById("view").scrollIntoView()')
        x, y = browser.value(f'page.view.placeOf(page.marks[{index}])')
        left, top, *_ = box(browser, '#view')
        taps = 0
        while browser.value('page.chosen') != index:
            browser.tap(left + 1 + x, top + 1 + y)
            browser.frame()
            taps += 1
            assert taps <= count
        seen = browser.value('''["#laid svg", "#view", "#which"].map(name => {
            const box = document.querySelector(name).getBoundingClientRect();
            return box.top >= -1 && box.bottom <= innerHeight && box.left >= 0 && box.right <= innerWidth + 1; })''')
        assert seen == [True, True, True]
        place = browser.value(f'page.view.placeOf(page.marks[{index}])')
        under = f'document.elementFromPoint({left + place[0]}, {top + place[1]})'
        assert browser.value(f'{under}.closest("#view") !== null')
    assert count == 5 and browser.complaints == []


@pytest.mark.parametrize('screen', [NARROW, WIDE])
def test_every_mark_is_a_button_that_opens_its_pair(show, page, replayed, screen):
    browser = show(page(), *screen)
    scans = np.flatnonzero(replayed.trajectory.used)
    for index, pair in enumerate(replayed.pairs):
        browser.value('page.close()')
        browser.click(f'#marks li:nth-child({index + 1}) button')
        browser.frame()
        scan, reference = scans[pair.number], scans[pair.reference_number]
        assert browser.value('document.getElementById("which").textContent') == (
            f'{index + 1} of {len(replayed.pairs)}: scan {scan} on scan {reference}')
        assert browser.value('document.getElementById("register").textContent') == f'show a.log {reference} {scan}'
        assert browser.value('drive.scan[page.current]') == scan
        status = 'OK' if pair.status.value == 'ok' else pair.status.value
        assert status in browser.value('document.getElementById("verdict").textContent')
        dots = browser.value('[...document.querySelectorAll("#laid .dots")].map(x => x.getAttribute("d").length)')
        walls = browser.value('[...document.querySelectorAll("#laid .wall")].map(x => x.getAttribute("d"))')
        assert len(dots) == 2 and min(dots) > 500 and walls[0].count('M') == walls[1].count('M') > 1
        assert browser.value('document.querySelectorAll("#plot-status .chosen").length') == 1
        _, top, _, height = box(browser, '#laid svg')
        assert top >= 0 and top + height <= screen[1]


def test_the_keyboard_alone_reaches_and_works_everything(show, page, known):
    browser = show(page(known, closed=True), *WIDE)
    reached = []
    while True:
        browser.press('Tab')
        name = browser.value('document.activeElement.id || document.activeElement.textContent')
        if name in reached or browser.value('document.activeElement === document.body'):
            break
        reached.append(name)
    assert [name for name in reached if name in ('theme', 'view', 'in', 'out', 'all', 'play', 'slider', 'speed')] == [
        'theme', 'view', 'in', 'out', 'all', 'play', 'slider', 'speed']
    assert [name[6:] for name in reached if name.startswith('layer-')] == [
        'scan', 'segments', 'covariance', 'trajectory', 'truth', 'wheels', 'keyframes', 'loops', 'marks', 'follow',
        'closed']
    assert len([name for name in reached if '%' in name]) == 5
    assert {'Sections of the drive as a table', 'Terms', 'Parameters'} <= set(reached)
    browser.value('document.querySelector("#marks li:nth-child(2) button").focus()')
    browser.press('Enter')
    assert browser.value('[page.chosen, document.activeElement.id]') == [1, 'pair']
    browser.press('Tab')
    assert browser.value('document.activeElement.id') == 'previous'
    browser.press('Escape')
    assert browser.value('[page.chosen, document.getElementById("pair").hidden]') == [-1, True]
    assert browser.value('document.activeElement === document.querySelector("#marks li:nth-child(2) button")')
    browser.value('document.activeElement.blur()')
    browser.press('ArrowRight')
    browser.press('ArrowRight')
    browser.press('ArrowLeft')
    assert browser.value('page.current') == browser.value('page.marks[1].at') + 1


def test_layers_are_switched_on_and_off(show, page, known):
    browser = show(page(known, closed=True), *WIDE)
    browser.value('page.go(20)')
    for name, canvas in (('scan', 'overlay'), ('segments', 'overlay'), ('trajectory', 'base'), ('truth', 'base'),
                         ('wheels', 'base'), ('keyframes', 'base')):
        browser.frame()
        on = browser.value(f'document.getElementById("layer-{name}").checked')
        before = colours(browser, canvas, name)
        browser.click(f'#layer-{name}')
        browser.frame()
        after = colours(browser, canvas, name)
        assert (before > after) if on else (after > before), name


def test_the_closed_map_is_a_switch(show, page):
    browser = show(page(closed=True), *WIDE)
    assert browser.value('document.getElementById("layer-closed").role') == 'switch'
    opened = browser.value('document.getElementById("base").toDataURL()')
    y = browser.value('page.view.poses[1]')
    browser.value('document.getElementById("layer-closed").focus()')
    browser.press(' ')
    browser.frame()
    assert browser.value('page.view.poses[1]') == y + 1.0
    assert browser.value('document.getElementById("base").toDataURL()') != opened
    browser.press(' ')
    browser.frame()
    assert browser.value('document.getElementById("base").toDataURL()') == opened


def test_the_given_map_shows_the_places_in_question_at_the_moment(show, page, in_map):
    browser = show(page(closed=True, in_map=in_map), *WIDE)
    now = 'document.getElementById("now").textContent.replaceAll("\\u00a0", " ")'
    browser.value('page.go(50)')
    browser.frame()
    assert browser.value(now).endswith('In the map: ambiguous; 48 %, 41 %, elsewhere 11 %.')
    shown = colours(browser, 'overlay', 'candidates')
    assert shown > 100
    browser.click('#layer-candidates')
    browser.frame()
    assert colours(browser, 'overlay', 'candidates') == 0
    browser.click('#layer-candidates')
    browser.value('page.go(51)')
    browser.frame()
    assert browser.value(now).endswith('In the map: not in this map; elsewhere 100 %.')
    assert colours(browser, 'overlay', 'candidates') == colours(browser, 'overlay', 'scan') == 0
    browser.value('page.go(90)')
    browser.frame()
    assert browser.value(now).endswith('In the map: localised.')
    assert colours(browser, 'overlay', 'candidates') == 0 and colours(browser, 'overlay', 'scan') > 100
    switches = '["known", "closed"].map(name => document.getElementById("layer-" + name).checked)'
    for name, states in (('closed', [False, True]), ('known', [True, False]), ('known', [False, False])):
        browser.click(f'#layer-{name}')
        assert browser.value(switches) == states
        assert browser.value('page.view.which') == [1, 2, 0][[states[1], states[0], True].index(True)]
    assert browser.complaints == []
