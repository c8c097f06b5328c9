
// Plots along the drive: each follows the slider with a cursor and moves it when it is clicked or dragged over.

const MARK_REACH = 16;

class Plot {
  constructor(parent, {id, name, note, unit, values, log, kind, levels, good, reviewed}, page) {
    Object.assign(this, {id, name, unit, values, log, kind, levels, good, reviewed, page});
    this.box = html(parent, 'div', undefined, 'plot');
    this.box.id = 'plot-' + id;
    html(this.box, 'p', note ? `${name}, ${note}` : name);
    this.canvas = html(this.box, 'div');
    const drag = event => this.take(event, false);
    this.canvas.addEventListener('pointerdown', event => {
      if (event.button) return;
      this.canvas.setPointerCapture(event.pointerId);
      this.take(event, true);
      this.canvas.addEventListener('pointermove', drag);
    });
    for (const end of ['pointerup', 'pointercancel'])
      this.canvas.addEventListener(end, () => this.canvas.removeEventListener('pointermove', drag));
    this.draw();
    new ResizeObserver(() => { if (![0, this.width].includes(this.box.clientWidth)) this.draw(); }).observe(this.box);
  }

  draw() {
    this.width = this.box.clientWidth;
    this.canvas.replaceChildren();
    const last = data.drive.along;
    this.chart = chart(this.canvas, {name: this.id, width: this.width, height: this.height(), x: [last.start || 0, last.end],
                                     xlabel: last.label, ...this.axis()});
    this.chart.root.setAttribute('aria-label', this.describe());
    this.series();
    this.cursor = svg(this.chart.front, 'line', {class: 'cursor', y1: this.chart.top, y2: this.chart.top + this.chart.h});
    this.follow();
  }

  height() { return 150; }

  // The values of the scans that there are.
  get known() { return this.values.subarray(0, drive.count); }

  transformed(value) { return this.log ? Math.log10(Math.max(value, 1e-4)) : value; }

  axis() {
    let low = Infinity, high = -Infinity;
    for (const value of this.known) if (value === value) { low = Math.min(low, value); high = Math.max(high, value); }
    if (!(high >= low)) [low, high] = [0.1, 1];
    if (!this.log) return {y: [Math.min(low, 0), 1.05 * Math.max(high, 0.1)], ylabel: `[${this.unit}]`};
    low = Math.floor(this.transformed(low)); high = Math.max(Math.ceil(this.transformed(high)), low + 1);
    const yticks = Array.from({length: high - low + 1}, (_, k) => [low + k, String(Number((10 ** (low + k)).toPrecision(3)))]);
    return {y: [low - 0.1, high + 0.1], yticks, ylabel: `[${this.unit}]`};
  }

  // For each column of pixels a line from the smallest to the largest value in it, joined to the next scan's value.
  series() {
    const {x, y, inside} = this.chart, parts = [];
    let column = -1, low = 0, high = 0, last = NaN;
    const flush = () => { if (column >= 0) parts.push(`M${column} ${y(low).toFixed(1)}V${(y(high) - 0.01).toFixed(1)}`); };
    for (let k = 0; k < drive.count; k++) {
      const value = this.transformed(this.values[k]), place = Math.round(x(drive.along[k]));
      if (Number.isNaN(value)) { last = NaN; continue; }
      if (place !== column) {
        flush();
        if (!Number.isNaN(last)) parts.push(`M${column} ${y(last).toFixed(1)}L${place} ${y(value).toFixed(1)}`);
        column = place; low = high = value;
      }
      last = value;
      low = Math.min(low, value); high = Math.max(high, value);
    }
    flush();
    const path = svg(inside, 'path', {class: 'series', d: parts.join('')});
    if (this.kind) path.style.stroke = `var(--${this.kind})`;
  }

  describe() {
    const sorted = this.known.filter(value => value === value).sort(), worst = this.values.indexOf(sorted[sorted.length - 1]);
    return sorted.length ? `${this.name} over ${data.drive.along.label}: median ${number(sorted[sorted.length >> 1])} ${this.unit}, ` +
      `largest ${number(sorted[sorted.length - 1])} ${this.unit} at scan ${drive.scan[worst]}` : this.name;
  }

  follow() {
    if (!drive.count) return;
    // On the page of a running node a new scan may lie beyond the end of the plot, which is drawn once a second.
    const {left, w} = this.chart, x = Math.min(this.chart.x(drive.along[this.page.current]), left + w);
    this.cursor.setAttribute('x1', x);
    this.cursor.setAttribute('x2', x);
  }

  take(event, pressed) {
    const box = this.chart.root.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    if (!drive.count || (pressed && this.marked(x, y))) return;
    const share = (x - this.chart.left) / this.chart.w, {start = 0, end} = data.drive.along;
    this.page.go(nearest(drive.along.subarray(0, drive.count), start + share * (end - start)));
  }

  marked() { return false; }
}

// A row for each of `levels`, thick red except in that of `good`, and one for the `reviewed` marks if there are any.
class StatusPlot extends Plot {
  height() { return 178; }

  axis() {
    const rows = [...this.levels, ...(this.reviewed.length ? ['to review'] : [])];
    return {y: [-0.5, rows.length - 0.5], yticks: rows.map((name, level) => [level, name])};
  }

  describe() {
    const counts = this.levels.map((name, level) => `${this.known.filter(value => value === level).length} ${name}`);
    return `${this.name} over ${data.drive.along.label}: ${counts.join(', ')}`;
  }

  series() {
    const {x, y, inside, front} = this.chart, seen = new Set(), parts = ['', ''];
    // The bar of a scan goes up to the next scan.
    for (let k = 0; k < drive.count; k++) {
      const level = this.values[k], place = Math.round(x(drive.along[k]));
      const next = k + 1 < drive.count ? Math.round(x(drive.along[k + 1])) : place;
      for (let column = place; column === place || column < next; column++) {
        if (seen.has(column * 8 + level)) continue;
        seen.add(column * 8 + level);
        parts[this.levels[level] === this.good ? 0 : 1] += `M${column} ${(y(level - 0.28)).toFixed(1)}V${(y(level + 0.28)).toFixed(1)}`;
      }
    }
    svg(inside, 'path', {class: 'series', d: parts[0]});
    svg(inside, 'path', {class: 'series bad', d: parts[1]});
    this.marks = this.reviewed.map(mark => svg(front, 'circle', {
      class: `mark ${mark.pair.status}`, r: 6, cx: x(drive.along[mark.at]), cy: y(this.levels.length)}));
    this.choose(this.page.chosen);
  }

  marked(x, y) {
    const level = this.chart.y(this.levels.length);
    return Math.abs(y - level) <= MARK_REACH && this.page.chooseAmong(
      this.reviewed.map(mark => Math.abs(this.chart.x(drive.along[mark.at]) - x)), MARK_REACH);
  }

  choose(index) {
    this.marks.forEach((circle, each) => circle.classList.toggle('chosen', each === index));
  }
}
