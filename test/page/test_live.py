# SPDX-License-Identifier: Apache-2.0
"""The live page without ROS: its map, its events and its web server."""
import contextlib
import http.client
import socket
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from events import Reader

from dbscan_reg_ros.replays.live import live_drive, server
from dbscan_reg_ros.replays.live.live_drive import LiveDrive
from dbscan_reg_ros.replays.live.live_map import CELL, MOST_CELLS, LiveMap
from dbscan_reg_ros.replays.live.server import NoFreePort, PageServer

TIMEOUT = 20.0


@pytest.fixture
def drive():
    return LiveDrive()


@pytest.fixture
def serve(drive):
    """``serve(host='127.0.0.1', port=...) -> PageServer`` of the drive."""
    with contextlib.ExitStack() as stack:
        yield lambda host='127.0.0.1', port=20000: stack.enter_context(PageServer(drive, host, port, '/scan'))


@pytest.fixture
def watched(replayed):
    """The scans of a drive as the listener passes them on."""
    return [SimpleNamespace(stamp=update.features.scan.stamp, pose=update.pose, covariance=update.covariance, speed=0.5,
                            points=update.features.scan.points[update.features.scan.valid])
            for update in replayed.updates]


def ask(address, path='/', method='GET', **headers):
    """Status and body of the answer to a request."""
    connection = http.client.HTTPConnection(address.host, address.port, timeout=TIMEOUT)
    with contextlib.closing(connection):
        connection.request(method, path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()


def until(condition, work=lambda: None):
    """Repeat `work` until the condition holds."""
    waiting = threading.Event()
    for _ in range(2000):
        if condition():
            return
        work()
        waiting.wait(0.01)
    raise AssertionError('the condition did not become true')


def test_the_map_counts_each_return_in_its_cell():
    random, live = np.random.default_rng(0), LiveMap()
    scans = [random.uniform(-12.0, 12.0, (500, 2)) + np.array((10.0 * k, -3.0 * k)) for k in range(4)]
    for points in scans:
        live.add(points)
    ink, (left, right, bottom, top) = live.density()
    assert live.cell == CELL
    cells = np.floor((np.concatenate(scans) - (left, bottom)) / CELL + 1e-9).astype(int)
    assert ink.shape == (round((top - bottom) / CELL), round((right - left) / CELL))
    expected = np.zeros(ink.shape, dtype=bool)
    expected[cells[:, 1], cells[:, 0]] = True
    np.testing.assert_array_equal(ink > 0.0, expected)


def test_the_map_of_a_kilometre_has_larger_cells_and_stays_below_20_mb():
    live = LiveMap()
    for k in range(200):
        live.add(np.array([(5.0 * k, 0.0), (5.0 * k, 3.0), (0.0, 5.0 * k)]))
    assert live.nbytes <= 2 * MOST_CELLS <= 20e6
    assert live.cell in (0.8, 1.6)
    ink, (left, right, bottom, top) = live.density()
    assert left < 0.0 and bottom < 0.0 and right > 995.0 and top > 995.0
    columns = ((np.arange(0.0, 1000.0, 5.0) - left) / live.cell).astype(int)
    assert (ink[int(-bottom / live.cell), columns] > 0.0).all()


@pytest.mark.parametrize(('most_events', 'most_bytes'), [(50, 8_000_000), (3000, 40_000)])
def test_events_are_kept_in_bounded_memory(drive, watched, monkeypatch, most_events, most_bytes):
    monkeypatch.setattr(live_drive, 'MOST_EVENTS', most_events)
    monkeypatch.setattr(live_drive, 'MOST_BYTES', most_bytes)
    for scan in watched:
        drive.add(scan)
    kept = next(drive.events(0.0))
    assert 5 < kept.count(b'event: scan') <= most_events and len(kept) < most_bytes + 100
    assert f'"time":{watched[-1].stamp * 1e-9}'.encode() in kept


def test_only_get_and_only_the_page_and_its_events(serve):
    address = serve()
    status, body = ask(address)
    assert status == 200 and '"live":true' in body and "connect-src 'self'" in body
    assert [ask(address, path)[0] for path in ('/x', '/../../etc/passwd', '/index.html')] == [404, 404, 404]
    assert [ask(address, '/', method)[0] for method in ('POST', 'PUT', 'DELETE', 'PATCH')] == [501] * 4


@pytest.mark.parametrize('name', ['evil.example', 'evil.example:80', '192.0.2.1', 'localhost.evil.example', ''])
def test_foreign_host_names_are_refused(serve, name):
    assert ask(serve(), '/', Host=name)[0] == 421
    assert ask(serve(), '/events', Host=name)[0] == 421


@pytest.mark.parametrize('name', ['localhost', '127.0.0.1:9000', '[::1]:20000'])
def test_names_of_this_computer_are_served(serve, name):
    """The port may be another one: that of the other end of a tunnel."""
    assert ask(serve(), '/', Host=name)[0] == 200


def test_an_address_of_the_network_needs_the_token(serve):
    address = serve('0.0.0.0')
    assert ask(address)[0] == ask(address, '/events')[0] == ask(address, '/?token=guess')[0] == 403
    assert len(address.token) >= 20 and address.address.endswith(f'/?token={address.token}')
    assert ask(address, f'/?token={address.token}')[0] == 200
    assert ask(address, f'/?token={address.token}', Host='evil.example')[0] == 421


def test_a_busy_port_leads_to_the_next(serve):
    first, second = serve(), serve()
    assert second.port > first.port and ask(second)[0] == 200


def test_errors_of_port_and_address_name_what_to_do(drive):
    with pytest.raises(NoFreePort, match=r'192\.0\.2\.1 port 20000: .*give another --host'):
        PageServer(drive, '192.0.2.1', 20000, '')
    with contextlib.ExitStack() as stack:
        for port in range(21000, 21000 + server.PORTS):
            taken = stack.enter_context(socket.socket())
            taken.bind(('127.0.0.1', port))
            taken.listen()
        with pytest.raises(NoFreePort, match='busy'):
            PageServer(drive, '127.0.0.1', 21000, '')


def test_ten_browsers_get_every_scan_and_one_that_stalls_delays_none(serve, drive, watched):
    address = serve()
    drive.restart('/node')
    stalled = socket.socket()
    stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    stalled.connect((address.host, address.port))
    stalled.sendall(b'GET /events HTTP/1.0\r\nHost: localhost\r\n\r\n')
    readers = [Reader(address.host, address.port) for _ in range(10)]
    until(lambda: drive.browsers == 11)
    for reader in readers:
        assert reader.next() == ('start', {'source': '/node'})
    for scan in watched * 5:
        drive.add(scan)
    for reader in readers:
        seen = [reader.next('scan')[1]['time'] for _ in range(5 * len(watched))]
        np.testing.assert_allclose(seen, [scan.stamp * 1e-9 for scan in watched * 5])
        reader.close()
    until(lambda: drive.browsers == 1, lambda: drive.add(watched[0]))
    stalled.close()


def test_a_browser_that_stalls_is_disconnected(serve, drive, watched, monkeypatch):
    monkeypatch.setattr(server._Handler, 'timeout', 0.3)
    address = serve()
    with socket.socket() as stalled:
        stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.connect((address.host, address.port))
        stalled.sendall(b'GET /events HTTP/1.0\r\nHost: localhost\r\n\r\n')
        until(lambda: drive.browsers == 1)
        until(lambda: drive.browsers == 0, lambda: drive.add(watched[0]))


def test_a_browser_that_connects_later_gets_what_is_kept_and_the_map(serve, drive, watched):
    address = serve()
    drive.restart('/node')
    for scan in watched[:50]:
        drive.add(scan)
    reader = Reader(address.host, address.port)
    assert reader.next()[0] == 'start'
    assert [reader.next()[0] for _ in range(50)] == ['scan'] * 50
    name, drawn = reader.next()
    assert name == 'map' and drawn['image'].startswith('data:image/png') and drawn['extent'][0] < drawn['extent'][1]
    drive.restart('/node')
    assert reader.next()[0] == 'start'
    drive.report(2, 'lost')
    drive.add(watched[0])
    event = reader.next('scan')[1]
    assert (event['status'], event['reason']) == (2, 'lost')
    reader.close()


def test_too_many_browsers_are_refused(serve, drive, monkeypatch):
    monkeypatch.setattr(server, 'MOST_BROWSERS', 2)
    address = serve()
    readers = [Reader(address.host, address.port), Reader(address.host, address.port)]
    until(lambda: drive.browsers == 2)
    assert ask(address, '/events')[0] == 503
    for reader in readers:
        reader.close()


def test_the_page_shows_each_scan_follows_and_pauses(serve, drive, watched, browser, monkeypatch):
    monkeypatch.setattr(live_drive, 'PERIOD', 0.0)
    browser.screen(390, 844)
    browser.open(serve().address)
    until(lambda: drive.browsers == 1)
    drive.restart('/node')
    drive.report(0, 'tracking')
    for scan in watched[:60]:
        drive.add(scan)

    def shown(expression):
        browser.value('new Promise(done => { const look = () => '
                      f'{expression} ? done(0) : setTimeout(look, 20); look(); }})')

    shown('drive.count === 60 && page.view.maps[0].tinted && page.plots.length === 2')
    assert browser.value('page.current') == 59
    pose = watched[59].pose
    np.testing.assert_allclose(browser.value('[...page.view.poses.subarray(177, 180)]'), (pose.x, pose.y, pose.theta),
                               atol=1e-3)
    counts = [len(scan.points) for scan in watched[:60]]
    np.testing.assert_array_equal(browser.value('[...drive.firstPoint.subarray(0, 61)]'), [0, *np.cumsum(counts)])
    browser.frame()
    assert 'Scan 59' in browser.value('document.getElementById("now").textContent')
    browser.value('document.getElementById("slider").focus()')
    browser.press('ArrowLeft')
    drive.report(1, 'no overlap')
    drive.add(watched[60])
    shown('drive.count === 61')
    browser.frame()
    assert browser.value('[page.current, document.getElementById("play").textContent]') == [58, 'Follow']
    browser.click('#play')
    browser.frame()
    assert 'warning, no overlap' in browser.value('document.getElementById("now").textContent')
    drive.restart('/node')
    shown('drive.count === 0')
    assert browser.complaints == []
    assert {request.partition(':')[0] for request in browser.requests} <= {'http', 'data'}


def test_the_page_keeps_the_latest_scans_only(serve, drive, watched, browser):
    browser.screen(1400, 900)
    browser.open(serve().address)
    until(lambda: drive.browsers == 1)
    before = browser.value('MOST')
    browser.value('''(() => { for (let k = 0; k < MOST + 500; k++) page.add({
        time: k, pose: [k, 0, 0], sigma: [1, 1, 0, 1], status: 0, reason: `reason ${k}`, speed: k,
        points: btoa("\\x01\\x00\\x02\\x00".repeat(1 + k % 3))}); })()''')
    count = before + 500 - 1000
    first, last, time, reason, points = browser.value(
        '[drive.scan[0], drive.scan[drive.count - 1], drive.time[drive.count - 1], '
        'data.drive.reasons[drive.reason[drive.count - 1]], drive.firstPoint[drive.count]]')
    assert browser.value('drive.count') == count and (first, last, time) == (1000, before + 499, before + 499)
    assert reason == f'reason {before + 499}' and points == sum(1 + k % 3 for k in range(1000, before + 500))
    assert f'the last {count} of {before + 500} scans' in browser.value(
        'document.getElementById("dropped").textContent')
    browser.frame()
    assert browser.complaints == []
