
// The map: what lies still on one canvas, the scan of the moment on another, so that a step draws one scan only.

// A line is interrupted where so many successive scans have no position: HOLE, LONGEST_GAP of metrics.py.
const OWN = 0, CLOSED = 1, KNOWN = 2, MAPS = ['map', 'closedMap', 'knownMap'];
const REACH = 24, CLICK = 6, ELLIPSE = 2.4477, HOLE = 3;
const LAYERS = [
  ['scan', 'scan', 'M6 7h0M15 7h0M24 7h0', true], ['segments', 'segments', 'M0 7H30', false], ['covariance', 'covariance', 'M4 7a11 5 0 1 0 22 0a11 5 0 1 0 -22 0', true],
  ['trajectory', 'trajectory, thick where not OK', 'M0 7H30', true], ['truth', 'truth', 'M0 7H30', true], ['wheels', 'wheel odometry', 'M0 7H30', false],
  ['candidates', 'possible places', 'M5 2L25 7L5 12L9 7z', true],
  ['keyframes', 'key frames', 'M12 4h6v6h-6z', false], ['loops', 'places seen again', 'M0 12L30 2', false], ['marks', 'scans to review', 'M9 7a6 6 0 1 0 12 0a6 6 0 1 0 -12 0', true],
];
const DASHES = {truth: [7, 4], wheels: [2, 4], segments: [9, 3, 2, 3], trajectory: [], loops: []};

for (const other of drive.others) if (other.kind.startsWith('other')) {
  const place = Number(other.kind.slice(5));
  LAYERS.splice(4 + place, 0, [other.kind, other.name, 'M0 7H30', true]);
  DASHES[other.kind] = [[12, 4], [3, 3], [12, 3, 3, 3], [5, 2], [1, 5]][place];
}

const percent = odds => `${Math.round(100 * odds)}\u00a0%`;

const isLocalised = k => data.drive.inMap.stateNames[drive.inMap.state[k]] === 'localised';

class MapView {
  constructor(page) {
    this.page = page;
    this.box = at('view');
    [this.base, this.overlay] = ['base', 'overlay'].map(id => at(id).getContext('2d'));
    this.shown = {};
    this.pointers = new Map();
    // OWN: the map of the odometry, CLOSED: after loop closing, KNOWN: the map of a file.
    this.which = OWN;
    this.maps = [this.load(data.map), null, null];
    this.paths();
    this.resize();
    this.showAll();
    new ResizeObserver(() => { if (this.box.clientWidth) { this.resize(); if (this.fitted) this.showAll(); else this.changed(); } }).observe(this.box);
    this.listen();
  }

  load(map) {
    const image = new Image(), result = {image, extent: map.extent, tinted: null};
    result.ready = image.decode ? (image.src = map.image, image.decode().catch(() => {})) : Promise.resolve();
    result.ready.then(() => this.recolour());
    return result;
  }

  // Ink of the picture in the colour of the theme, transparent elsewhere.
  recolour() {
    this.colours = {};
    const style = getComputedStyle(document.documentElement);
    for (const name of ['paper', 'ink', 'density', 'bad', 'chosen', ...LAYERS.map(([name]) => name)])
      this.colours[name] = style.getPropertyValue('--' + name).trim();
    for (const map of this.maps || []) if (map && map.image.naturalWidth) this.tint(map);
    this.changed();
  }

  tint(map) {
    const canvas = map.tinted = document.createElement('canvas');
    [canvas.width, canvas.height] = [map.image.naturalWidth, map.image.naturalHeight];
    const context = canvas.getContext('2d');
    context.drawImage(map.image, 0, 0);
    context.globalCompositeOperation = 'source-in';
    context.fillStyle = this.colours.density;
    context.fillRect(0, 0, canvas.width, canvas.height);
  }

  // Lines in metres, made once; only their width follows the zoom.
  paths() {
    const line = (positions, step) => {
      const path = new Path2D();
      let missing = HOLE;
      for (let i = 0; i < positions.length; i += step) {
        if (Number.isNaN(positions[i])) { missing++; continue; }
        path[missing < HOLE ? 'lineTo' : 'moveTo'](positions[i], positions[i + 1]);
        missing = 0;
      }
      return path;
    };
    const bad = poses => {
      const path = new Path2D();
      for (let k = 1; k < drive.count; k++) if (drive.status[k]) {
        path.moveTo(poses[3 * k - 3], poses[3 * k - 2]);
        path.lineTo(poses[3 * k], poses[3 * k + 1]);
      }
      return path;
    };
    const pairs = ends => {
      const path = new Path2D();
      for (let i = 0; i < ends.length; i += 4) { path.moveTo(ends[i], ends[i + 1]); path.lineTo(ends[i + 2], ends[i + 3]); }
      return path;
    };
    const all = poses => ({trajectory: line(poses, 3), bad: bad(poses)});
    const known = drive.inMap && drive.inMap.pose.map((value, i) => isLocalised((i - i % 3) / 3) ? value : NaN);
    this.lines = [all(drive.pose), drive.closed && all(drive.closed.pose), known && all(known)];
    this.lines[0].loops = drive.closed && pairs(drive.closed.open);
    if (drive.closed) this.lines[1].loops = pairs(drive.closed.shut);
    for (const other of drive.others) for (const lines of this.lines.slice(0, KNOWN)) if (lines) lines[other.kind] = line(other.at, 2);
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    [this.width, this.height] = [this.box.clientWidth, this.box.clientHeight];
    for (const context of [this.base, this.overlay]) {
      context.canvas.width = Math.round(this.width * ratio);
      context.canvas.height = Math.round(this.height * ratio);
    }
    this.ratio = ratio;
  }

  // Show one of MAPS, which is decoded when it is shown for the first time.
  show(which) {
    const moved = (which === KNOWN) !== (this.which === KNOWN);
    if (!this.maps[which]) this.maps[which] = this.load(data[MAPS[which]]);
    this.which = which;
    if (moved) this.showAll();
  }

  get poses() { return [drive.pose, drive.closed, drive.inMap].map((each, which) => which ? each && each.pose : each)[this.which]; }

  get sigma() { return this.which === KNOWN ? drive.inMap.sigma : drive.sigma; }

  showAll() {
    const [left, right, bottom, top] = this.maps[this.which].extent;
    this.scale = this.least = 0.98 * Math.min(this.width / (right - left), this.height / (top - bottom));
    this.centre = [(left + right) / 2, (bottom + top) / 2];
    this.fitted = true;
    this.changed();
  }

  toPixels(x, y) { return [this.width / 2 + (x - this.centre[0]) * this.scale, this.height / 2 - (y - this.centre[1]) * this.scale]; }

  toMetres(px, py) { return [this.centre[0] + (px - this.width / 2) / this.scale, this.centre[1] - (py - this.height / 2) / this.scale]; }

  // Zoom by a factor so that the place under the pixel stays there.
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.toMetres(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, 0.3 * this.least), 3000);
    const [nx, ny] = this.toPixels(x, y);
    this.pan(px - nx, py - ny);
  }

  pan(dx, dy) {
    this.fitted = false;
    this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale];
    this.changed();
  }

  changed() { this.stale = true; this.page.redraw(); }

  inMetres(context) {
    const scale = this.ratio * this.scale;
    context.setTransform(scale, 0, 0, -scale, this.ratio * this.width / 2 - scale * this.centre[0], this.ratio * this.height / 2 + scale * this.centre[1]);
  }

  inPixels(context) { context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0); }

  clear(context) {
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, context.canvas.width, context.canvas.height);
  }

  draw() {
    if (this.shown.follow && drive.count) {
      const k = this.page.current, centre = [this.poses[3 * k], this.poses[3 * k + 1]];
      if (centre[0] === centre[0] && (centre[0] !== this.centre[0] || centre[1] !== this.centre[1])) { this.centre = centre; this.stale = true; }
    }
    if (this.stale) this.drawBase();
    this.stale = false;
    this.drawMoment();
  }

  drawBase() {
    const context = this.base, map = this.maps[this.which], lines = this.lines[this.which];
    this.clear(context);
    this.inPixels(context);
    const [left, right, bottom, top] = map.extent, [x, y] = this.toPixels(left, top);
    context.imageSmoothingEnabled = this.scale * (right - left) < 2 * map.image.naturalWidth;
    if (map.tinted) context.drawImage(map.tinted, x, y, (right - left) * this.scale, (top - bottom) * this.scale);
    this.inMetres(context);
    for (const [name, width] of [['loops', 1.2], ['wheels', 1.6], ['truth', 2], ...drive.others.filter(other => other.kind.startsWith('other')).map(other => [other.kind, 2]), ['trajectory', 1.8]])
      if (this.shown[name] && lines[name]) this.stroke(context, lines[name], name, width);
    if (this.shown.trajectory) this.stroke(context, lines.bad, 'bad', 4.5);
    this.inPixels(context);
    if (this.shown.keyframes && this.which !== KNOWN) this.drawKeyFrames(context);
    if (this.shown.marks) for (const mark of this.page.marks) this.drawMark(context, mark, false);
    this.drawScale();
  }

  stroke(context, path, name, width) {
    context.strokeStyle = this.colours[name];
    context.lineWidth = width / this.scale;
    context.lineJoin = 'round';
    context.setLineDash((DASHES[name] || []).map(length => length / this.scale));
    context.stroke(path);
    context.setLineDash([]);
  }

  drawKeyFrames(context) {
    const positions = drive.keyFrames[this.which === CLOSED ? 'closed' : 'open'];
    context.strokeStyle = this.colours.keyframes;
    context.lineWidth = 1.4;
    for (let i = 0; i < positions.length; i += 2) {
      const [x, y] = this.toPixels(positions[i], positions[i + 1]);
      context.strokeRect(x - 3, y - 3, 6, 6);
    }
  }

  drawMark(context, mark, chosen) {
    const [x, y] = this.placeOf(mark);
    context.beginPath();
    context.arc(x, y, chosen ? 9 : 7, 0, 7);
    context.fillStyle = chosen ? this.colours.chosen : this.colours.paper;
    context.strokeStyle = this.colours.marks;
    context.lineWidth = 1.8;
    context.setLineDash(mark.pair.status === 'ok' && !chosen ? [2.5, 2.5] : []);
    context.fill();
    context.stroke();
    context.setLineDash([]);
  }

  placeOf(mark) { return this.toPixels(this.poses[3 * mark.at], this.poses[3 * mark.at + 1]); }

  drawScale() {
    const metres = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find(m => m * this.scale >= 60) || 2000;
    at('scale').style.width = `${metres * this.scale}px`;
    at('scale').textContent = metres < 1 ? `${Math.round(100 * metres)} cm` : `${metres} m`;
  }

  drawMoment() {
    const context = this.overlay, k = this.page.current;
    this.clear(context);
    if (!drive.count) return;
    const [x, y, theta] = this.poses.subarray(3 * k, 3 * k + 3), unit = data.drive.resolution;
    const c = Math.cos(theta) * unit, s = Math.sin(theta) * unit;
    const place = (u, v) => this.toPixels(x + c * u - s * v, y + s * u + c * v);
    this.inPixels(context);
    if (Number.isNaN(x)) return;
    if (drive.points && this.shown.scan) this.drawReturns(context, k, place);
    if (drive.points && this.shown.segments) this.drawSegments(context, k, place);
    const [px, py] = this.toPixels(x, y);
    if (this.shown.covariance) this.drawEllipse(context, k, px, py);
    if (this.shown.marks && this.page.chosen >= 0) this.drawMark(context, this.page.marks[this.page.chosen], true);
    if (this.which !== KNOWN || isLocalised(k)) this.drawArrow(context, px, py, theta, this.colours.ink);
    else if (this.shown.candidates) this.drawCandidates(context, k);
  }

  drawReturns(context, k, place) {
    context.fillStyle = this.colours.scan;
    for (let i = drive.firstPoint[k]; i < drive.firstPoint[k + 1]; i++) {
      const [px, py] = place(drive.points[2 * i], drive.points[2 * i + 1]);
      context.fillRect(px - 1.5, py - 1.5, 3, 3);
    }
  }

  drawSegments(context, k, place) {
    context.strokeStyle = this.colours.segments;
    context.lineWidth = 2.5;
    context.setLineDash(DASHES.segments);
    context.beginPath();
    for (let i = drive.firstSegment[k]; i < drive.firstSegment[k + 1]; i++) {
      context.moveTo(...place(drive.segments[4 * i], drive.segments[4 * i + 1]));
      context.lineTo(...place(drive.segments[4 * i + 2], drive.segments[4 * i + 3]));
    }
    context.stroke();
    context.setLineDash([]);
  }

  // An arrow at each place, and its probability.
  drawCandidates(context, k) {
    const places = drive.inMap.places(k);
    context.font = '600 13px system-ui, "DejaVu Sans", sans-serif';
    context.lineJoin = 'round';
    for (let i = 0; i < places.length; i += 4) {
      const [x, y, theta, odds] = places.subarray(i, i + 4), [px, py] = this.toPixels(x, y);
      this.drawArrow(context, px, py, theta, this.colours.candidates);
      this.inPixels(context);
      context.strokeStyle = this.colours.paper;
      context.lineWidth = 4;
      context.fillStyle = this.colours.candidates;
      for (const write of ['strokeText', 'fillText']) context[write](percent(odds), px + 12, py - 8);
    }
  }

  drawEllipse(context, k, px, py) {
    const [long, short, direction] = this.sigma.subarray(4 * k, 4 * k + 3), reach = ELLIPSE * this.scale;
    context.strokeStyle = this.colours.covariance;
    context.lineWidth = 2;
    context.beginPath();
    context.ellipse(px, py, Math.min(reach * long, 1e5), Math.min(reach * short, 1e5), -direction, 0, 2 * Math.PI);
    context.stroke();
  }

  drawArrow(context, px, py, theta, colour) {
    context.setTransform(this.ratio, 0, 0, this.ratio, this.ratio * px, this.ratio * py);
    context.rotate(-theta);
    context.beginPath();
    context.moveTo(11, 0); context.lineTo(-7, 7); context.lineTo(-4, 0); context.lineTo(-7, -7); context.closePath();
    context.fillStyle = colour;
    context.strokeStyle = this.colours.paper;
    context.lineWidth = 1.5;
    context.fill();
    context.stroke();
  }

  listen() {
    const box = this.box, local = event => { const r = box.getBoundingClientRect(); return [event.clientX - r.left - 1, event.clientY - r.top - 1]; };
    box.addEventListener('wheel', event => { event.preventDefault(); this.zoom(Math.exp(-event.deltaY * 0.0015), ...local(event)); }, {passive: false});
    box.addEventListener('pointerdown', event => {
      if (event.button || event.target.closest('#zoom')) return;
      box.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, local(event));
      this.moved = this.pointers.size > 1 ? CLICK + 1 : 0;
    });
    box.addEventListener('pointermove', event => { if (this.pointers.has(event.pointerId)) this.dragged(event.pointerId, local(event)); });
    for (const end of ['pointerup', 'pointercancel']) box.addEventListener(end, event => {
      if (!this.pointers.delete(event.pointerId)) return;
      if (end === 'pointerup' && this.moved <= CLICK && !this.pointers.size) this.tapped(...local(event));
    });
    box.addEventListener('keydown', event => this.pressed(event));
    at('in').addEventListener('click', () => this.zoom(1.6));
    at('out').addEventListener('click', () => this.zoom(1 / 1.6));
    at('all').addEventListener('click', () => this.showAll());
  }

  dragged(id, [x, y]) {
    const [before, other] = [this.pointers.get(id), [...this.pointers].find(([key]) => key !== id)];
    this.pointers.set(id, [x, y]);
    this.moved += Math.hypot(x - before[0], y - before[1]);
    if (other) {
      const [ox, oy] = other[1];
      this.pan((x - before[0]) / 2, (y - before[1]) / 2);
      this.zoom(Math.max(Math.hypot(x - ox, y - oy), 1) / Math.max(Math.hypot(before[0] - ox, before[1] - oy), 1), (x + ox) / 2, (y + oy) / 2);
    } else if (this.moved > CLICK) this.pan(x - before[0], y - before[1]);
  }

  pressed(event) {
    const step = 60, keys = {ArrowLeft: () => this.pan(step, 0), ArrowRight: () => this.pan(-step, 0), ArrowUp: () => this.pan(0, step),
      ArrowDown: () => this.pan(0, -step), '+': () => this.zoom(1.4), '=': () => this.zoom(1.4), '-': () => this.zoom(1 / 1.4), 0: () => this.showAll()};
    if (event.target !== this.box || event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }

  // A tap chooses the nearest mark, the next one where several lie together; elsewhere the scan on the trajectory.
  tapped(px, py) {
    const away = (x, y) => Math.hypot(x - px, y - py);
    if (this.shown.marks && this.page.chooseAmong(this.page.marks.map(mark => away(...this.placeOf(mark))), REACH)) return;
    let best = REACH, found = -1;
    for (let k = 0; k < drive.count; k++) {
      const distance = away(...this.toPixels(this.poses[3 * k], this.poses[3 * k + 1]));
      if (distance < best) { best = distance; found = k; }
    }
    if (found >= 0) this.page.go(found);
  }
}
