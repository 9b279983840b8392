/* Numbers from base64, and a plot of uPlot in the colours of the page. */
"use strict";

function unpack(text, precision) {
  const raw = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return precision === 8 ? new Float64Array(raw.buffer) : new Float32Array(raw.buffer);
}

const COLORS = ["#4477aa", "#ee6677", "#228833", "#aa3377", "#ccaa22", "#33aabb", "#8866cc", "#777777"];

function pageColor(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/* Six digits, as short as they are: uPlot rounds to three behind the point, which leaves nothing of a micrometre. */
function formatted(value) {
  if (value === null || value === undefined) return "--";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) return value.toExponential(5).replace(/\.?0+e/, "e").replace("e+", "e");
  return String(Number(value.toPrecision(6)));
}

/* Dashes for a curve that would hide one before it for most of the time, as in `acausal/plot/plot.py`; all share rows. */
function dashOver(curves, k) {
  const finite = curves.flat().filter(Number.isFinite);
  const near = 0.01 * (finite.reduce((a, b) => Math.max(a, b), -Infinity) - finite.reduce((a, b) => Math.min(a, b), Infinity));
  const hides = (other) => curves[k].filter((v, i) => v !== null && other[i] !== null && Math.abs(v - other[i]) <= near).length > curves[k].length / 2;
  return curves.slice(0, k).some(hides) ? [6, 4] : [];
}

function axisStyle(label) {
  const values = (plot, splits) => splits.map((v) => (v === null ? "" : formatted(Number(v.toPrecision(12)))));
  const axis = { values, stroke: pageColor("--faint"), grid: { stroke: pageColor("--line"), width: 0.5 }, ticks: { stroke: pageColor("--line") } };
  return label ? { ...axis, label, labelSize: 18, labelFont: "12px sans-serif", size: 56 } : axis;
}
