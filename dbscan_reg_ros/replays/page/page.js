
// The page: one current scan, which map, plots, slider and texts follow.

const SPEEDS = [1, 4, 16, 64, 256], LONGEST_PLAY = 90;

function number(value) { return value === 0 ? '0' : Number(value.toPrecision(3)).toString(); }

const word = status => status === 'ok' ? 'OK' : status;

function sentence(k) {
  const status = word(data.drive.statusNames[drive.status[k]]), reason = data.drive.reasons[drive.reason[k]];
  const known = drive.inMap ? ` In the map: ${stateInMap(k)}.` : '';
  return `Scan ${drive.scan[k]}, ${drive.time[k].toFixed(1)} s, ${drive.distance[k].toFixed(2)} m: ${status}${reason ? ', ' + reason : ''}.${known}`;
}

// The state in the map of a file, with the probabilities of the places and that of none of them.
function stateInMap(k) {
  const state = data.drive.inMap.stateNames[drive.inMap.state[k]], places = drive.inMap.places(k);
  if (isLocalised(k)) return state;
  const odds = Array.from({length: places.length / 4}, (_, i) => places[4 * i + 3]), rest = Math.max(1 - odds.reduce((sum, each) => sum + each, 0), 0);
  return `${state}; ${[...odds.slice(0, 3).map(percent), ...odds.length > 3 ? ['...'] : [], `elsewhere ${percent(rest)}`].join(', ')}`;
}

class Page {
  constructor() {
    this.current = 0;
    this.chosen = -1;
    this.playing = 0;
    this.marks = data.pairs.map(pair => ({pair, at: 0}));
    const numbers = drive.scan;
    for (const mark of this.marks) mark.at = nearest(numbers, mark.pair.scan);
    this.texts();
    this.view = new MapView(this);
    this.layers();
    this.plots = [];
    // The map comes first: the plots are drawn after its first frame.
    this.plotted = new Promise(done => requestAnimationFrame(() => setTimeout(() => { this.plots = this.makePlots(); done(); })));
    this.review();
    this.controls();
    this.recolour();
    this.go(0);
  }

  texts() {
    at('review').hidden = data.live;
    at('sections').closest('details').hidden = !data.sections.length;
    document.title = `${data.live ? 'live' : 'replay'}: ${data.title}`;
    at('title').textContent = data.title;
    for (const [name, value] of data.summary) {
      const row = html(at('summary'), 'div');
      html(row, 'dt', name);
      html(row, 'dd', value);
    }
    at('dropped').textContent = data.drive.dropped;
    at('nothing').textContent = data.nothing;
    const header = html(html(at('sections'), 'thead'), 'tr'), body = html(at('sections'), 'tbody');
    for (const name of ['from [m]', 'to [m]', 'scans', 'not OK', 'longest processing time [ms]']) html(header, 'th', name).scope = 'col';
    for (const row of data.sections) { const line = html(body, 'tr'); for (const value of row) html(line, 'td', value === null ? 'unknown' : String(value)); }
    this.parameters();
  }

  parameters() {
    at('parameters').parentElement.hidden = !data.parameters.length;
    const changed = data.parameters.filter(parameter => parameter.changed).length;
    at('changes').textContent = changed ? `${changed} not at the default, in bold.` : 'All at their defaults.';
    for (const parameter of data.parameters) {
      const row = html(at('parameters'), 'tr', undefined, parameter.changed ? 'changed' : '');
      html(row, 'th', parameter.name).scope = 'row';
      html(row, 'td', `${parameter.value} ${parameter.unit}`);
      html(row, 'td', parameter.changed ? `default ${parameter.default}` : '');
      html(row, 'td', parameter.help);
    }
  }

  layers() {
    const kinds = new Set(drive.others.map(other => other.kind)), absent = {truth: !kinds.has('truth'), wheels: !kinds.has('wheels'), loops: !drive.closed, marks: !this.marks.length, candidates: !drive.inMap,
      segments: data.live || drive.count > 0 && !drive.firstSegment[drive.count], covariance: !data.live && drive.sigma.every((value, i) => i % 4 || value === 0), keyframes: !drive.keyFrames.open.length};
    for (const [name, label, d, on] of LAYERS) if (!absent[name]) {
      const box = this.toggle(name, label, on, value => { this.view.shown[name] = value; });
      const width = {scan: 4, marks: 1.8, trajectory: 2}[name] || 2;
      key(box.parentElement, 'path', {d, fill: 'none', 'stroke-linecap': name === 'scan' ? 'round' : 'butt', 'stroke-dasharray': (DASHES[name] || []).join(' '),
                                      style: `stroke: var(--${name}); stroke-width: ${width}`});
    }
    this.toggle('follow', 'follow the sensor', false, value => { this.view.shown.follow = value; });
    this.mapSwitch(CLOSED, 'closed', 'closed map', drive.closed, false);
    this.mapSwitch(KNOWN, 'known', 'in the given map', drive.inMap, true);
  }

  // A switch between the map of the odometry and another one; switching one on switches the other off.
  mapSwitch(which, name, label, there, on) {
    if (!there) return;
    this.toggle(name, label, on, value => {
      if (value) for (const box of document.querySelectorAll('#layers [role=switch]')) box.checked = box.id === 'layer-' + name;
      if (value || this.view.which === which) this.view.show(value ? which : OWN);
    }).setAttribute('role', 'switch');
  }

  toggle(name, label, on, set) {
    const entry = html(at('layers'), 'label'), box = html(entry, 'input');
    box.type = 'checkbox';
    box.id = 'layer-' + name;
    box.checked = on;
    entry.append(label);
    set(on);
    box.addEventListener('change', () => { set(box.checked); this.view.changed(); });
    return box;
  }

  makePlots() {
    const errors = drive.plots.filter(plot => plot.id !== 'time'), times = drive.plots.filter(plot => plot.id === 'time');
    const status = {id: 'status', name: 'Status', note: '', unit: '', values: drive.status, levels: data.drive.statusNames.map(word), good: 'OK', reviewed: this.marks};
    const inMap = drive.inMap && {id: 'in-map', name: 'State in the given map', note: '', unit: '', values: drive.inMap.state, levels: data.drive.inMap.stateNames.map(name => name.replace('this ', '')), good: 'localised', reviewed: []};
    return [...errors.map(plot => new Plot(at('plots'), plot, this)), new StatusPlot(at('plots'), status, this), ...inMap ? [new StatusPlot(at('plots'), inMap, this)] : [], ...times.map(plot => new Plot(at('plots'), plot, this))];
  }

  review() {
    at('hint').textContent = this.marks.length ? 'The first scan of each section that is not OK, and the OK scans with the least overlap.' : 'There is nothing to review.';
    pairLegend(at('pair-legend'));
    this.buttons = this.marks.map((mark, index) => {
      const button = html(html(at('marks'), 'li'), 'button', `${mark.pair.scan}: ${word(mark.pair.status)}, ${Math.round(100 * mark.pair.overlap)} %`);
      button.type = 'button';
      button.setAttribute('aria-label', `scan ${mark.pair.scan}: ${word(mark.pair.status)}, overlap ${Math.round(100 * mark.pair.overlap)} %`);
      button.addEventListener('click', () => this.choose(index));
      return button;
    });
    at('previous').addEventListener('click', () => this.choose((this.chosen + this.marks.length - 1) % this.marks.length));
    at('next').addEventListener('click', () => this.choose((this.chosen + 1) % this.marks.length));
    at('close').addEventListener('click', () => this.close());
    at('pair').addEventListener('keydown', event => { if (event.key === 'Escape') this.close(); });
  }

  controls() {
    const slider = at('slider'), times = drive.time, length = drive.count ? times[drive.count - 1] : 0;
    slider.max = Math.max(drive.count - 1, 0);
    slider.disabled = at('play').disabled = drive.count < 2;
    slider.addEventListener('input', () => this.go(Number(slider.value)));
    for (const speed of SPEEDS) html(at('speed'), 'option', `${speed} x`).value = speed;
    at('speed').value = SPEEDS.find(speed => length / speed <= LONGEST_PLAY) || SPEEDS[SPEEDS.length - 1];
    at('play').addEventListener('click', () => this.play(!this.playing));
    at('theme').addEventListener('click', () => { document.documentElement.dataset.theme = isDark() ? 'light' : 'dark'; this.recolour(); });
    document.addEventListener('keydown', event => {
      const by = {ArrowLeft: -1, ArrowRight: 1}[event.key];
      if (event.target === document.body && by) this.go(this.current + by);
    });
  }

  recolour() {
    at('theme').textContent = isDark() ? 'Light colours' : 'Dark colours';
    this.view.recolour();
  }

  // Show the scan with this number among those of the page.
  go(k) {
    this.current = Math.min(Math.max(k, 0), Math.max(drive.count - 1, 0));
    this.redraw();
  }

  redraw() {
    if (this.pending || !this.view) return;
    this.pending = true;
    requestAnimationFrame(() => { this.pending = false; this.draw(); });
  }

  draw() {
    this.view.draw();
    if (!drive.count || !this.plots) return;
    for (const plot of this.plots) plot.follow();
    const text = sentence(this.current);
    at('slider').value = this.current;
    at('slider').setAttribute('aria-valuetext', text);
    at('now').textContent = text;
    this.values();
  }

  values() {
    const k = this.current, pose = this.view.poses, [long, short, , turn] = this.view.sigma.subarray(4 * k, 4 * k + 4), degrees = 180 / Math.PI;
    const rows = [['scan', `${drive.scan[k]}`], ['pose', Number.isNaN(pose[3 * k]) ? 'unknown' : `x ${pose[3 * k].toFixed(3)} m, y ${pose[3 * k + 1].toFixed(3)} m, ${(degrees * pose[3 * k + 2]).toFixed(2)}°`],
      ['sigma', long ? `${number(long)} m and ${number(short)} m, ${number(degrees * turn)}°` : 'unknown'], ['status', word(data.drive.statusNames[drive.status[k]])],
      ...drive.inMap ? [['in the map', stateInMap(k)]] : [],
      ['reason', data.drive.reasons[drive.reason[k]] || 'none'],
      ...data.live ? [] : [['registered to', drive.reference[k] < 0 ? 'no scan' : `scan ${drive.reference[k]}, overlap ${Math.round(100 * drive.overlap[k])} %`]],
      ...drive.plots.map(plot => [plot.short, plot.values[k] === plot.values[k] ? `${number(plot.values[k])} ${plot.unit}` : 'unknown'])];
    const list = at('values');
    if (list.children.length !== 2 * rows.length) { list.replaceChildren(); for (const [name] of rows) { html(list, 'dt', name); html(list, 'dd'); } }
    rows.forEach(([, value], row) => { list.children[2 * row + 1].textContent = value; });
  }

  play(on) {
    at('play').textContent = on ? 'Pause' : 'Play';
    at('play').setAttribute('aria-pressed', on);
    at('now').setAttribute('aria-live', on ? 'off' : 'polite');
    cancelAnimationFrame(this.playing);
    this.playing = 0;
    if (!on) return;
    if (this.current === drive.count - 1) this.go(0);
    let last = performance.now(), time = drive.time[this.current];
    const step = now => {
      time += (now - last) / 1000 * Number(at('speed').value);
      last = now;
      let k = this.current;
      if (Math.abs(drive.time[k] - time) > 2 * Number(at('speed').value)) time = drive.time[k];
      while (k < drive.count - 1 && drive.time[k + 1] <= time) k++;
      if (k !== this.current) this.go(k);
      if (k === drive.count - 1) this.play(false); else this.playing = requestAnimationFrame(step);
    };
    this.playing = requestAnimationFrame(step);
  }

  // Choose the nearest of the marks within reach of a tap, or the one after the chosen among these; whether there is one.
  chooseAmong(distances, reach) {
    const near = distances.map((distance, index) => [distance, index]).filter(([distance]) => distance <= reach).sort((a, b) => a[0] - b[0] || a[1] - b[1]).map(([, index]) => index);
    if (!near.length) return false;
    this.choose(near[(near.indexOf(this.chosen) + 1) % near.length]);
    return true;
  }

  choose(index) {
    const {pair, at: k} = this.marks[index], box = at('pair');
    if (box.hidden) this.opener = document.activeElement;
    this.chosen = index;
    box.hidden = false;
    at('which').textContent = `${index + 1} of ${this.marks.length}: scan ${pair.scan} on scan ${pair.on}`;
    at('verdict').textContent = `After ${drive.distance[k].toFixed(2)} m: ${word(pair.status)}${pair.reason ? ', ' + pair.reason : ''}; ${(100 * pair.overlap).toFixed(0)} % of the scan on the reference.`;
    at('register').textContent = `${data.register} ${pair.on} ${pair.scan}`;
    drawPair(at('laid'), pair);
    box.scrollTop = at('side').scrollTop = 0;
    this.buttons.forEach((button, each) => button.setAttribute('aria-current', each === index));
    for (const plot of this.plots) if (plot.choose) plot.choose(index);
    if (!box.contains(document.activeElement)) box.focus({preventScroll: true});
    this.makeVisible();
    this.view.stale = true;
    this.go(k);
  }

  // Where the pair covers the lower half of the screen, the map is brought to its upper half.
  makeVisible() {
    const map = at('view').getBoundingClientRect();
    if (map.top < 0 || map.bottom > window.innerHeight * (window.innerWidth < 1000 ? 0.46 : 1)) at('view').scrollIntoView({block: 'start'});
  }

  close() {
    at('pair').hidden = true;
    this.chosen = -1;
    for (const button of this.buttons) button.removeAttribute('aria-current');
    for (const plot of this.plots) if (plot.choose) plot.choose(-1);
    if (this.opener && this.opener.isConnected) this.opener.focus({preventScroll: true});
    this.view.changed();
  }
}

const isDark = () => document.documentElement.dataset.theme === 'dark';
document.documentElement.dataset.theme = matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light';
