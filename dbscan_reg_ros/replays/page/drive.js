
'use strict';
// The drive as typed arrays, one value for each scan that the page holds.

function content(id) {
  const element = document.getElementById(id), text = element.textContent;
  element.remove();
  return text;
}

const data = JSON.parse(content('data'));

function bytes(text) {
  const letters = atob(text), result = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) result[i] = letters.charCodeAt(i);
  return result;
}

const floats = text => new Float32Array(bytes(text).buffer);
const integers = text => new Int32Array(bytes(text).buffer);
const shorts = text => new Uint16Array(bytes(text).buffer);

// Where each scan begins in an array of all, from how much each has.
function starts(counts) {
  const result = new Uint32Array(counts.length + 1);
  for (let k = 0; k < counts.length; k++) result[k + 1] = result[k] + counts[k];
  return result;
}

// Where the sensor may be in the map of a file: poses and probabilities; the pose is the most probable, else NaN.
function inMap({state, sigma, counts, places}) {
  const first = starts(shorts(counts)), rows = floats(places), pose = new Float32Array(3 * (first.length - 1)).fill(NaN);
  for (let k = 0; k < first.length - 1; k++)
    if (first[k] < first[k + 1]) pose.set(rows.subarray(4 * first[k], 4 * first[k] + 3), 3 * k);
  return {state: bytes(state), sigma: floats(sigma), pose, places: k => rows.subarray(4 * first[k], 4 * first[k + 1])};
}

const drive = (() => {
  const d = data.drive;
  return {
    count: d.count, along: floats(d.along.at), scan: integers(d.scan), time: floats(d.time), pose: floats(d.pose),
    distance: floats(d.distance), sigma: floats(d.sigma), status: bytes(d.status), reason: integers(d.reason),
    overlap: floats(d.overlap), reference: integers(d.reference), plots: d.plots.map(plot => ({...plot, values: floats(plot.values)})),
    others: d.others.map(other => ({...other, at: floats(other.at)})), firstPoint: starts(shorts(d.points)),
    firstSegment: starts(shorts(d.segments)), keyFrames: {open: floats(d.keyFrames.open), closed: floats(d.keyFrames.closed)},
    closed: d.closed && {pose: floats(d.closed.pose), count: d.closed.count, open: floats(d.closed.loops.open), shut: floats(d.closed.loops.closed)},
    inMap: d.inMap && inMap(d.inMap), points: null, segments: null,
  };
})();

// Returns and segments of all scans: differences of coordinates that are added up here, then the ends of the segments.
async function unpackScans() {
  const packed = new Blob([bytes(content('scans'))]);
  const buffer = await new Response(packed.stream().pipeThrough(new DecompressionStream('deflate'))).arrayBuffer();
  const numbers = new Int16Array(buffer), count = 2 * drive.firstPoint[drive.count];
  for (let i = 2; i < count; i++) numbers[i] += numbers[i - 2];
  drive.points = numbers.subarray(0, count);
  drive.segments = numbers.subarray(count);
}

// The scan of the page whose number, or value along the drive, is nearest.
function nearest(sorted, value) {
  let low = 0, high = sorted.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (sorted[middle] <= value) low = middle; else high = middle;
  }
  return Math.abs(sorted[high] - value) < Math.abs(sorted[low] - value) ? high : Math.max(low, 0);
}
