
// The page of a running node: each event adds a scan to the drive, of which the latest are kept.

const MOST = 3000, DROPPED = 1000, RETURNS = 720;
// Name -> values for each scan, of all arrays that have some.
const WIDTHS = {along: 1, scan: 1, time: 1, pose: 3, distance: 1, sigma: 4, status: 1, reason: 1};

for (const [name, width] of Object.entries(WIDTHS)) drive[name] = new drive[name].constructor(MOST * width);
drive.reason.forEach((_, k) => { drive.reason[k] = k; });
drive.plots[0].values = new Float32Array(MOST);
drive.firstPoint = new Uint32Array(MOST + 1);
drive.firstSegment = new Uint32Array(MOST + 1);
drive.points = new Int16Array(2 * RETURNS * MOST);
drive.segments = new Int16Array(0);
data.drive.reasons = Array(MOST).fill('');

class LivePage extends Page {
  constructor() {
    super();
    this.begin('');
    this.play(true);
    at('speed').parentElement.hidden = true;
    at('dropped').setAttribute('role', 'status');
    html(at('terms'), 'dt', 'ok, warning, error, stale');
    html(at('terms'), 'dd', 'On this page the status is the level of the last report of the node on /diagnostics, which comes once a second, and the reason is its message.');
    setInterval(() => { if (this.unplotted) for (const plot of this.plots) plot.draw(); this.unplotted = false; }, 1000);
    this.listen();
  }

  listen() {
    const source = new EventSource('events' + location.search), on = (name, work) => source.addEventListener(name, event => work(JSON.parse(event.data)));
    on('start', ({source}) => this.begin(source));
    on('scan', event => this.add(event));
    on('map', event => this.showMap(event));
    source.addEventListener('error', () => this.say('The connection is lost; trying again.'));
  }

  say(text) { if (at('dropped').textContent !== text) at('dropped').textContent = text; }

  // Forget the drive before.
  begin(node) {
    this.node = node;
    this.total = drive.count = this.current = 0;
    this.first = null;
    this.view.maps[0] = {image: new Image(), extent: [-5, 5, -5, 5], tinted: null};
    this.view.showAll();
    this.view.paths();
    data.drive.along.start = 0;
    data.drive.along.end = 1;
    this.unplotted = true;
    this.say(node ? `Connected to ${node}; waiting for scans.` : 'Waiting for a node.');
    this.redraw();
  }

  add({time, pose, sigma, status, reason, speed, points}) {
    if (drive.count === MOST) this.drop();
    const k = drive.count, returns = new Int16Array(bytes(points).buffer), begin = drive.firstPoint[k];
    if (this.first === null) this.first = time;
    drive.points.set(returns.subarray(0, 2 * RETURNS), 2 * begin);
    drive.firstPoint[k + 1] = begin + Math.min(returns.length / 2, RETURNS);
    drive.pose.set(pose, 3 * k);
    drive.sigma.set(sigma, 4 * k);
    drive.scan[k] = this.total++;
    drive.time[k] = drive.along[k] = time - this.first;
    drive.distance[k] = k ? drive.distance[k - 1] + Math.hypot(pose[0] - drive.pose[3 * k - 3], pose[1] - drive.pose[3 * k - 2]) : 0;
    drive.status[k] = status;
    drive.plots[0].values[k] = speed;
    data.drive.reasons[k] = reason;
    data.drive.along.start = drive.along[0];
    data.drive.along.end = Math.max(drive.along[k], drive.along[0] + 1);
    drive.count++;
    this.extend(k);
    at('slider').max = k;
    at('slider').disabled = at('play').disabled = k < 1;
    this.say(`Connected to ${this.node}.` + (this.total > drive.count ? ` The page holds the last ${drive.count} of ${this.total} scans.` : ''));
    this.unplotted = this.view.stale = true;
    if (this.playing) super.go(k); else this.redraw();
  }

  extend(k) {
    const lines = this.view.lines[0], [x, y] = drive.pose.subarray(3 * k, 3 * k + 2);
    lines.trajectory[k ? 'lineTo' : 'moveTo'](x, y);
    if (!k || !drive.status[k]) return;
    lines.bad.moveTo(drive.pose[3 * k - 3], drive.pose[3 * k - 2]);
    lines.bad.lineTo(x, y);
  }

  // Drop the oldest scans.
  drop() {
    const begin = drive.firstPoint[DROPPED];
    for (const [name, width] of Object.entries(WIDTHS)) if (name !== 'reason') drive[name].copyWithin(0, DROPPED * width);
    data.drive.reasons.copyWithin(0, DROPPED);
    drive.plots[0].values.copyWithin(0, DROPPED);
    drive.points.copyWithin(0, 2 * begin);
    drive.firstPoint.copyWithin(0, DROPPED);
    drive.firstPoint.forEach((_, k) => { drive.firstPoint[k] -= begin; });
    drive.count -= DROPPED;
    this.current = Math.max(this.current - DROPPED, 0);
    this.view.paths();
  }

  showMap(event) {
    const map = this.view.load(event), node = this.node;
    map.ready.then(() => {
      if (node !== this.node) return;
      this.view.maps[0] = map;
      this.view.recolour();
      if (this.view.fitted) this.view.showAll();
    });
  }

  go(k) {
    if (this.playing && k < drive.count - 1) this.play(false);
    super.go(k);
  }

  // Follow the newest scan, or stay at the present one.
  play(on) {
    this.playing = on ? 1 : 0;
    at('play').textContent = on ? 'Pause' : 'Follow';
    at('play').setAttribute('aria-pressed', on);
    at('now').setAttribute('aria-live', on ? 'off' : 'polite');
    if (on && drive.count) super.go(drive.count - 1);
  }
}

const page = new LivePage();
const ready = page.plotted.then(() => { document.body.dataset.ready = 'yes'; });
