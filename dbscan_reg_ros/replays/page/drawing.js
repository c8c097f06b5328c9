
// Elements of the page, axes with round numbers, paths in SVG.

const at = id => document.getElementById(id);

function svg(parent, tag, attributes, text) {
  const element = parent.appendChild(document.createElementNS('http://www.w3.org/2000/svg', tag));
  for (const [name, value] of Object.entries(attributes || {})) element.setAttribute(name, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

function html(parent, tag, text, className) {
  const element = parent.appendChild(document.createElement(tag));
  if (text !== undefined) element.textContent = text;
  if (className) element.className = className;
  return element;
}

// Round values from low to high, at most `most` of them, with their labels.
function ticks(low, high, most) {
  const rough = Math.max((high - low) / most, 1e-9), power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find(factor => factor * power >= rough * 0.999);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), result = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) result.push([k * step, (k * step).toFixed(digits)]);
  return result;
}

// A frame with labelled axes; gives x(value) and y(value) in pixels and `inside`, which clips what is drawn.
function chart(parent, {x: [left, right], y: [bottom, top], width, height, xlabel, ylabel, yticks, name}) {
  const margin = {left: 82, right: 12, top: 8, bottom: xlabel ? 40 : 8}, clip = 'clip-' + name;
  const w = width - margin.left - margin.right, h = height - margin.top - margin.bottom;
  const x = value => margin.left + w * (value - left) / (right - left);
  const y = value => margin.top + h * (top - value) / (top - bottom);
  const root = svg(parent, 'svg', {viewBox: `0 0 ${width} ${height}`, width, height, role: 'img'});
  svg(svg(root, 'clipPath', {id: clip}), 'rect', {x: margin.left, y: margin.top, width: w, height: h});
  const back = svg(root, 'g'), inside = svg(root, 'g', {'clip-path': `url(#${clip})`}), front = svg(root, 'g');
  for (const [value, label] of ticks(left, right, Math.max(w / 70, 2))) {
    svg(back, 'line', {class: 'grid', x1: x(value), x2: x(value), y1: margin.top, y2: margin.top + h});
    if (xlabel) svg(front, 'text', {x: x(value), y: margin.top + h + 16, 'text-anchor': 'middle'}, label);
  }
  for (const [value, label] of yticks || ticks(bottom, top, Math.max(h / 40, 2))) {
    svg(back, 'line', {class: 'grid', x1: margin.left, x2: margin.left + w, y1: y(value), y2: y(value)});
    svg(front, 'text', {x: margin.left - 7, y: y(value) + 4, 'text-anchor': 'end'}, label);
  }
  svg(front, 'rect', {class: 'frame', x: margin.left, y: margin.top, width: w, height: h});
  if (xlabel) svg(front, 'text', {x: margin.left + w / 2, y: height - 6, 'text-anchor': 'middle'}, xlabel);
  if (ylabel) svg(front, 'text', {transform: `translate(14 ${margin.top + h / 2}) rotate(-90)`, 'text-anchor': 'middle'}, ylabel);
  return {x, y, inside, front, root, left: margin.left, w, h, top: margin.top};
}

// A sample of a line or marker for a legend.
function key(parent, tag, attributes) {
  svg(svg(parent, 'svg', {class: 'key', viewBox: '0 0 30 14', 'aria-hidden': 'true'}), tag, attributes);
}
