# SPDX-License-Identifier: Apache-2.0
"""A real browser without a window, driven over its debugging pipe."""
import base64
import itertools
import json
import os
import select
import shutil
import signal
import subprocess
import sys

NAMES = 'chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable', 'chrome'
OPTIONS = ('--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--hide-scrollbars',
           '--disable-background-networking', '--disable-component-update', '--disable-sync', '--disable-dev-shm-usage',
           '--remote-debugging-pipe', '--window-size=1120,900')
PATIENCE = 60.0
"""Time [s] within which the browser must answer."""
NARROW = 700
"""Width [pixels] below which a screen is that of a phone."""
LAUNCH = """
import fcntl, os, sys
for target, pipe in enumerate([fcntl.fcntl(int(number), fcntl.F_DUPFD, 10) for number in sys.argv[1:3]], 3):
    os.dup2(pipe, target)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""The browser reads commands from file 3 and writes answers to file 4."""


def find_browser():
    """The path of a chromium, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """One page in a browser with a fresh profile in the folder `profile`.

    Attributes
    ----------
    complaints : list of str
        Exceptions of the page's scripts, and what its console says in red.
    requests : list of str
        Every address that the page asks for.
    """

    def __init__(self, profile):
        self.complaints, self.requests = [], []
        self._numbers, self._buffer = itertools.count(1), b''
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        self._process = subprocess.Popen(
            [sys.executable, '-S', '-c', LAUNCH, str(to_browser), str(from_browser), find_browser(), *OPTIONS,
             f'--user-data-dir={profile}', 'about:blank'],
            pass_fds=(to_browser, from_browser), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True)
        os.close(to_browser)
        os.close(from_browser)
        self._session = None
        self._attach(next(t for t in self.call('Target.getTargets')['targetInfos'] if t['type'] == 'page')['targetId'])

    def _attach(self, target):
        self._target = target
        self._session = self.call('Target.attachToTarget', targetId=target, flatten=True)['sessionId']
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.call(f'{domain}.enable')

    def renew(self):
        """Close the page and open an empty one, without a screen or complaints of its own."""
        closed, self._session = self._target, None
        opened = self.call('Target.createTarget', url='about:blank')['targetId']
        self.call('Target.closeTarget', targetId=closed)
        self._attach(opened)
        self.complaints, self.requests = [], []

    def call(self, method, **parameters):
        """The answer of the browser to a command of its debugging protocol."""
        number = next(self._numbers)
        message = {'id': number, 'method': method, 'params': parameters}
        if self._session:
            message['sessionId'] = self._session
        os.write(self._out, json.dumps(message).encode() + b'\0')
        while (answer := self._receive()).get('id') != number:
            self._note(answer)
        assert 'error' not in answer, answer
        return answer['result']

    def open(self, address):
        """Load a page to the end."""
        self.call('Page.navigate', url=address)
        loaded = 'Page.loadEventFired', self._session
        while ((event := self._receive()).get('method'), event.get('sessionId')) != loaded:
            self._note(event)

    def value(self, expression):
        """What a JavaScript expression gives in the page; of a promise, what it is fulfilled with."""
        result = self.call('Runtime.evaluate', expression=expression, returnByValue=True, awaitPromise=True)
        assert 'exceptionDetails' not in result, result
        return result['result'].get('value')

    def click(self, selector):
        """Scroll the element into view and press the mouse's button over its middle."""
        x, y = self.value(f'''(() => {{
            const element = document.querySelector({json.dumps(selector)});
            element.scrollIntoView({{block: 'center'}});
            const box = element.getBoundingClientRect();
            return [box.left + box.width / 2, box.top + box.height / 2];
        }})()''')
        for kind in ('mousePressed', 'mouseReleased'):
            self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left', clickCount=1)

    def screen(self, width, height, dark=False):
        """Set the size of the screen, with touch where it is narrow, and what theme the user prefers."""
        narrow = width < NARROW
        self.call('Emulation.setDeviceMetricsOverride', width=width, height=height, deviceScaleFactor=1, mobile=narrow)
        self.call('Emulation.setTouchEmulationEnabled', enabled=narrow, maxTouchPoints=5 if narrow else 1)
        self.call('Emulation.setEmulatedMedia', features=[
            {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}])

    def mouse(self, kind, x, y, **more):
        """Send a mouse event: ``mousePressed``, ``mouseMoved``, ``mouseReleased`` or ``mouseWheel``."""
        self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, **{'button': 'left', 'clickCount': 1, **more})

    def tap(self, x, y):
        """Touch the screen at a place with one finger."""
        self.touch('touchStart', (x, y))
        self.touch('touchEnd')

    def touch(self, kind, *fingers):
        """Send a touch event with fingers at the given places."""
        points = [{'x': x, 'y': y, 'id': finger} for finger, (x, y) in enumerate(fingers)]
        self.call('Input.dispatchTouchEvent', type=kind, touchPoints=points)

    def press(self, key, code=None):
        """Press and release a key, by its name in JavaScript."""
        codes = {'Tab': 9, 'Enter': 13, 'Escape': 27, ' ': 32, 'ArrowLeft': 37, 'ArrowUp': 38, 'ArrowRight': 39,
                 'ArrowDown': 40}
        text = {'Enter': '\r'}.get(key, key if len(key) == 1 else '')
        for kind in ('keyDown', 'keyUp'):
            more = {'text': text} if text and kind == 'keyDown' else {}
            self.call('Input.dispatchKeyEvent', type=kind, key=key, code=code or key,
                      windowsVirtualKeyCode=codes.get(key, ord(key[0].upper())), **more)

    def frame(self):
        """Wait until the page has drawn what was asked for until now."""
        self.value('new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))')

    def picture(self, path):
        """Write what is to be seen as a PNG."""
        path.write_bytes(base64.b64decode(self.call('Page.captureScreenshot')['data']))

    @property
    def process(self) -> int:
        """Number of the browser's first process, which leads a session of all."""
        return self._process.pid

    def close(self):
        """End all processes of the browser."""
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._in)
        os.close(self._out)

    def _receive(self):
        while b'\0' not in self._buffer:
            assert select.select([self._in], [], [], PATIENCE)[0], f'the browser is silent for {PATIENCE:.0f} s'
            more = os.read(self._in, 1 << 20)
            assert more, 'the browser has ended'
            self._buffer += more
        message, _, self._buffer = self._buffer.partition(b'\0')
        return json.loads(message)

    def _note(self, event):
        if event.get('sessionId') != self._session:
            return
        method, parameters = event.get('method'), event.get('params', {})
        if method == 'Runtime.exceptionThrown':
            self.complaints.append(str(parameters['exceptionDetails']))
        elif method == 'Log.entryAdded' and parameters['entry']['level'] == 'error':
            self.complaints.append(parameters['entry']['text'])
        elif method == 'Network.requestWillBeSent':
            self.requests.append(parameters['request']['url'])
