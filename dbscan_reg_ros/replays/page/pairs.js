
// A pair to review: the scan where the odometry lays it on its reference.

const dots = (c, [xs, ys]) => xs.map((x, i) => `M${c.x(x).toFixed(1)} ${c.y(ys[i]).toFixed(1)}h0`).join('');
const walls = (c, lines) => lines.map(([x1, y1, x2, y2]) => `M${c.x(x1).toFixed(1)} ${c.y(y1).toFixed(1)}L${c.x(x2).toFixed(1)} ${c.y(y2).toFixed(1)}`).join('');

function drawPair(parent, pair) {
  const xs = [0, ...pair.reference[0], ...pair.current[0]], ys = [0, ...pair.reference[1], ...pair.current[1]];
  const margin = 0.3, left = Math.min(...xs) - margin, right = Math.max(...xs) + margin, bottom = Math.min(...ys) - margin, top = Math.max(...ys) + margin;
  const wide = parent.clientWidth || 360, most = window.innerWidth < 1000 ? 0.22 * window.innerHeight : 0.42 * window.innerHeight;
  const scale = Math.min((wide - 94) / (right - left), most / (top - bottom));
  parent.replaceChildren();
  const c = chart(parent, {name: 'pair', x: [left, right], y: [bottom, top], xlabel: 'x [m]', ylabel: 'y [m]',
                           width: 94 + scale * (right - left), height: 48 + scale * (top - bottom)});
  c.root.setAttribute('aria-label', `Returns of scan ${pair.scan} laid on those of scan ${pair.on}`);
  for (const [name, lines] of [['reference', pair.lines[0]], ['current', pair.lines[1]]])
    svg(c.inside, 'path', {class: `wall ${name}`, d: walls(c, lines)});
  svg(c.inside, 'path', {class: 'dots reference', d: dots(c, pair.reference)});
  svg(c.inside, 'path', {class: 'dots current', d: dots(c, pair.current)});
}

function pairLegend(parent) {
  for (const [tag, name, d, text] of [['dots', 'reference', 'M5 7h0M15 7h0M25 7h0', 'reference'], ['dots', 'current', 'M5 7h0M15 7h0M25 7h0', 'scan, at its estimated pose'],
    ['wall', 'reference', 'M0 7H30', 'matched segments of the reference'], ['wall', 'current', 'M0 7H30', 'and of the scan']]) {
    const entry = html(parent, 'li');
    key(entry, 'path', {class: `${tag} ${name}`, d});
    entry.append(text);
  }
}
