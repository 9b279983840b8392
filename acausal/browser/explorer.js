/* Results to look at: a tree of signals, panels by unit, several results over each other, differences, events.

   app.ready                    a promise of the page with its data
   app.select(names)            show these signals
   app.curve(name, k)           {t, y} of signal `name` of result k, in the unit that is shown
   app.difference(name, k)      {t, y}: result k minus the first one, at the times of the first
   app.search(text)             names that are left in the tree
   app.setUnit(unit, shown)     show panels of a unit in another
   app.zoom(a, b), app.events(k), app.picture(), app.panels()                                            */
"use strict";

const app = (() => {
  const results = acausal.results, place = document.getElementById("panels"), tree = document.getElementById("tree");
  const shownUnit = {}, DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3], [14, 5]];
  let selected = [], range = null, plots = [];

  async function unpackColumns(result) {
    result.t = unpack(result.time, 8);
    const raw = Uint8Array.from(atob(result.columns), (c) => c.charCodeAt(0));
    const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
    result.matrix = new Float64Array(await new Response(stream).arrayBuffer());
    delete result.columns;
  }

  /* Values of a signal over the rows of its result, in the declared unit. */
  function values(result, name) {
    const signal = result.signals[name];
    if (!signal) return null;
    const [, , column, sign, value] = signal;
    if (column < 0) return new Float64Array(result.rows).fill(value === null ? NaN : value);
    const found = result.matrix.slice(column * result.rows, (column + 1) * result.rows);
    return sign < 0 ? found.map((v) => 0 - v) : found;
  }

  function described(name) {
    const holder = results.find((r) => r.signals[name]);
    return { unit: holder.signals[name][0], doc: holder.signals[name][1] };
  }

  function scale(unit) {
    const shown = shownUnit[unit] ?? unit;
    const [, slope, offset] = (acausal.units[unit] || []).find((u) => u[0] === shown) || [unit, 1, 0];
    return { shown, slope, offset };
  }

  /* At the times of another run, straight between rows; on both sides of a jump the value of that side. */
  function interpolated(result, y, times) {
    const t = result.t, n = t.length, found = new Float64Array(times.length);
    let i = 0;
    for (let k = 0; k < times.length; k++) {
      const at = times[k], after = k > 0 && times[k - 1] === at;
      if (at < t[0] || at > t[n - 1]) { found[k] = NaN; continue; }
      while (i + 1 < n && t[i + 1] <= at) i++;
      let row = i;
      // The value before a jump, unless the other run asks for the one after.
      if (t[row] === at && !after && (k + 1 < times.length && times[k + 1] === at)) while (row > 0 && t[row - 1] === at) row--;
      found[k] = t[row] === at || row + 1 >= n ? y[row] : y[row] + ((y[row + 1] - y[row]) * (at - t[row])) / (t[row + 1] - t[row]);
    }
    return found;
  }

  function curve(name, k) {
    const y = values(results[k], name);
    if (!y) return null;
    const { slope, offset } = scale(described(name).unit);
    return { t: results[k].t, y: y.map((v) => v * slope + offset) };
  }

  function difference(name, k) {
    const first = values(results[0], name), other = values(results[k], name);
    if (!first || !other) return null;
    const { slope } = scale(described(name).unit), there = interpolated(results[k], other, results[0].t);
    return { t: results[0].t, y: there.map((v, i) => (v - first[i]) * slope) };
  }

  /* The tree: names by their dots, an index belongs to its name. */
  function buildTree() {
    const names = [...new Set(results.flatMap((r) => Object.keys(r.signals)))], root = { children: new Map(), leaves: [] };
    for (const name of names) {
      const parts = name.split(".");
      let here = root;
      for (const part of parts.slice(0, -1)) {
        if (!here.children.has(part)) here.children.set(part, { children: new Map(), leaves: [] });
        here = here.children.get(part);
      }
      here.leaves.push([parts[parts.length - 1], name]);
    }
    fill(tree, root);
  }

  /* Branches are filled when they are opened: thousands of signals cost nothing before. */
  function fill(parent, node) {
    for (const [label, child] of node.children) {
      const branch = document.createElement("details"), head = document.createElement("summary");
      head.textContent = label;
      branch.appendChild(head);
      branch.addEventListener("toggle", () => { if (branch.open && branch.childElementCount === 1) fill(branch, child); });
      parent.appendChild(branch);
    }
    for (const [label, name] of node.leaves) parent.appendChild(leaf(label, name));
  }

  function leaf(label, name) {
    const line = document.createElement("label"), box = document.createElement("input"), { unit, doc } = described(name);
    box.type = "checkbox";
    box.checked = selected.includes(name);
    box.dataset.name = name;
    box.addEventListener("change", () => select(box.checked ? [...selected, name] : selected.filter((n) => n !== name)));
    line.append(box, text("span", "", label), text("span", "unit", unit && unit !== "1" ? `[${unit}]` : ""), text("span", "doc", doc));
    line.title = [name, doc].filter(Boolean).join(": ");
    return line;
  }

  function text(kind, cls, content) {
    const made = document.createElement(kind);
    made.className = cls;
    made.textContent = content;
    return made;
  }

  function search(wanted) {
    tree.textContent = "";
    const words = wanted.toLowerCase().split(/\s+/).filter(Boolean);
    if (!words.length) { buildTree(); return []; }
    const names = [...new Set(results.flatMap((r) => Object.keys(r.signals)))];
    const found = names.filter((n) => words.every((w) => `${n} ${described(n).doc}`.toLowerCase().includes(w)));
    for (const name of found.slice(0, 500)) tree.appendChild(leaf(name, name));
    if (found.length > 500) tree.appendChild(text("div", "doc", `and ${found.length - 500} more`));
    return found;
  }

  function select(names) {
    selected = names.filter((n) => results.some((r) => r.signals[n]));
    for (const box of tree.querySelectorAll("input")) box.checked = selected.includes(box.dataset.name);
    draw();
  }

  /* Panels: signals of one unit together, or each alone; differences below. */
  function groups() {
    const apart = document.getElementById("apart").checked, found = new Map();
    for (const name of selected) {
      const { unit } = described(name), key = apart ? name : unit;
      if (!found.has(key)) found.set(key, { unit, names: [] });
      found.get(key).names.push(name);
    }
    return [...found.values()];
  }

  function draw() {
    for (const plot of plots) plot.destroy();
    plots = [];
    place.textContent = "";
    const differing = results.length > 1 && document.getElementById("difference").checked;
    for (const group of groups()) {
      panel(group, (name, k) => curve(name, k), 0, "");
      if (differing) panel(group, (name, k) => difference(name, k), 1, "difference ");
    }
    if (range) zoom(...range);
  }

  function panel(group, made, first, prefix) {
    const curves = [];
    group.names.forEach((name, color) => {
      for (let k = first; k < results.length; k++) {
        const found = made(name, k);
        if (found) curves.push({ ...found, name, k, color });
      }
    });
    if (!curves.length) return;
    const box = text("div", "panel", ""), head = text("div", "head", "");
    const menu = document.createElement("select");
    for (const [unit] of acausal.units[group.unit] || [[group.unit]]) menu.append(new Option(unit || "1", unit));
    menu.value = scale(group.unit).shown;
    menu.disabled = menu.options.length < 2;
    menu.addEventListener("change", () => setUnit(group.unit, menu.value));
    head.append(prefix ? text("span", "", prefix + "to " + results[0].label) : text("span", "", ""), menu);
    box.appendChild(head);
    place.appendChild(box);
    plots.push(plotted(box, curves, prefix, scale(group.unit).shown));
  }

  /* Rows of all curves in one table, as uPlot wants it; a run with other times has gaps there, and is joined. */
  function table(curves) {
    const tables = curves.map((c) => [Array.from(c.t), Array.from(c.y, (v) => (Number.isFinite(v) ? v : null))]);
    const same = curves.every((c) => c.t === curves[0].t);
    // Two rows at one time, before and after an event, would be one to uPlot: the later is moved by next to nothing.
    for (const [t] of tables) for (let i = 1; i < t.length; i++) if (t[i] <= t[i - 1]) t[i] = t[i - 1] + Math.max(1e-12, Math.abs(t[i - 1]) * 4e-16);
    if (same) return [tables[0][0], ...tables.map((t) => t[1])];
    return uPlot.join(tables, tables.map(() => [1]));
  }

  function plotted(box, curves, prefix, unit) {
    const rows = table(curves);
    // Dashes tell results apart if there are several, otherwise curves that coincide.
    const dash = (c, i) => (results.length > 1 ? DASHES[c.k % DASHES.length] : dashOver(rows.slice(1), i));
    const series = curves.map((c, i) => ({
      label: prefix + c.name + (results.length > 1 ? ` · ${results[c.k].label}` : ""),
      stroke: COLORS[c.color % COLORS.length], dash: dash(c, i), width: 1.5, spanGaps: false, value: (u, v) => formatted(v), points: { show: false },
    }));
    const options = {
      width: Math.max(300, place.clientWidth - 24), height: 220, pxAlign: 0, series: [{ label: "t [s]", value: (u, v) => formatted(v) }, ...series],
      axes: [axisStyle(), axisStyle(unit === "1" ? "" : unit)], scales: { x: { time: false } },
      cursor: { sync: { key: "acausal" }, drag: { x: true, y: false } }, legend: { live: true },
      hooks: {
        draw: [drawEvents],
        setSelect: [(u) => { if (u.select.width > 2) zoom(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")); u.setSelect({ width: 0, height: 0 }, false); }],
      },
    };
    const plot = new uPlot(options, rows, box);
    plot.over.addEventListener("dblclick", () => zoom(null, null));
    return plot;
  }

  function drawEvents(plot) {
    if (!document.getElementById("events").checked) return;
    const context = plot.ctx, { left, top, width, height } = plot.bbox;
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    context.strokeStyle = pageColor("--faint");
    context.globalAlpha = 0.5;
    context.setLineDash([3, 4]);
    for (const result of results) {
      for (const [t] of result.events) {
        const x = plot.valToPos(t, "x", true);
        context.beginPath();
        context.moveTo(x, top);
        context.lineTo(x, top + height);
        context.stroke();
      }
    }
    context.restore();
  }

  /* What happened when: a click shows the time around it. */
  function listEvents() {
    const list = document.getElementById("happened"), found = results.flatMap((r) => r.events.map((e) => [...e, r.label]));
    found.sort((a, b) => a[0] - b[0]);
    list.hidden = !found.length;
    list.querySelector("summary").textContent = `${found.length} event${found.length === 1 ? "" : "s"}`;
    for (const [t, condition, component, label] of found.slice(0, 500)) {
      const line = text("div", "", `${formatted(t)} s  ${[component, condition].filter(Boolean).join(": ")}`);
      line.title = results.length > 1 ? label : "";
      line.addEventListener("click", () => {
        const r = results.find((one) => one.label === label), room = (r.t[r.rows - 1] - r.t[0]) / 50;
        zoom(t - room, t + room);
      });
      list.appendChild(line);
    }
  }

  function zoom(a, b) {
    range = a === null ? null : [a, b];
    const low = Math.min(...results.map((r) => r.t[0])), high = Math.max(...results.map((r) => r.t[r.rows - 1]));
    for (const plot of plots) plot.setScale("x", { min: a ?? low, max: b ?? high });
  }

  function setUnit(unit, shown) {
    shownUnit[unit] = shown;
    draw();
  }

  /* All panels with their legends in one PNG. */
  function picture() {
    const ratio = window.devicePixelRatio || 1, line = 16 * ratio, made = document.createElement("canvas");
    const heights = plots.map((p) => p.ctx.canvas.height + line * (p.series.length - 1) + line);
    made.width = Math.max(1, ...plots.map((p) => p.ctx.canvas.width));
    made.height = Math.max(1, heights.reduce((a, b) => a + b, 0));
    const context = made.getContext("2d");
    context.fillStyle = pageColor("--back");
    context.fillRect(0, 0, made.width, made.height);
    context.font = `${12 * ratio}px sans-serif`;
    let y = 0;
    plots.forEach((plot, i) => {
      context.drawImage(plot.ctx.canvas, 0, y);
      plot.series.slice(1).forEach((s, k) => {
        const at = y + plot.ctx.canvas.height + line * (k + 0.7);
        context.strokeStyle = context.fillStyle = s.stroke();
        context.lineWidth = 2 * ratio;
        context.setLineDash((s.dash || []).map((d) => d * ratio));
        context.beginPath();
        context.moveTo(56 * ratio, at - 4 * ratio);
        context.lineTo(84 * ratio, at - 4 * ratio);
        context.stroke();
        context.fillStyle = pageColor("--text");
        context.fillText(s.label, 90 * ratio, at);
      });
      y += heights[i];
    });
    return made.toDataURL("image/png");
  }

  document.querySelector("h1").textContent = document.title;
  document.getElementById("results").textContent = results.length > 1 ? "— " + results.map((r, k) => `${r.label} ${["solid", "dashed", "dotted", "dash-dotted", "long dashes"][k % 5]}`).join(", ") : "";
  document.getElementById("differing").hidden = results.length < 2;
  document.getElementById("search").addEventListener("input", (e) => search(e.target.value));
  for (const id of ["difference", "apart", "events"]) document.getElementById(id).addEventListener("change", draw);
  document.getElementById("whole").addEventListener("click", () => zoom(null, null));
  document.getElementById("picture").addEventListener("click", () => {
    const link = document.createElement("a");
    link.href = picture();
    link.download = document.title.replace(/[^\w.-]+/g, "_") + ".png";
    link.click();
  });
  let waiting = 0;
  window.addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(draw, 150); });

  const ready = Promise.all(results.map(unpackColumns)).then(() => { buildTree(); listEvents(); select(acausal.selected); return app; });
  return {
    ready, select, curve, difference, search, setUnit, zoom, picture,
    events: (k) => results[k].events,
    panels: () => plots.map((p) => ({ signals: p.series.slice(1).map((s) => s.label), unit: p.axes[1].label || "", x: [p.scales.x.min, p.scales.x.max] })),
  };
})();
window.app = app;
